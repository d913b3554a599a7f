//! Thresholds that decide: one place, each with meaning, unit, range and origin.
//!
//! A threshold whose origin is "hand-set" was chosen by its author. No validation set fixed it.

/// When an effect is adopted on the training runs, and when values of the model are wrong.
pub(crate) struct Adoption {
    /// Gain of log evidence that names the first effect, and a further one. Unit and range: nats, above 0. Origin: hand-set.
    pub(crate) min_gain: [f64; 2],
    /// Coefficient of a delay that is wanted in full. Unit and range: share, 0 to 1. Origin: true delays 0.70 to 0.98, imitations
    /// of play and friction 0.51 to 0.66.
    pub(crate) min_delay_coefficient: f64,
    /// Log evidence by which the best must be ahead for a rival not to explain the same. Unit and range: nats, above 0. Origin: hand-set.
    pub(crate) rival_gap: f64,
    /// Log evidence of a law of the angle over that of another one of the same joint that bodies may make up for. Unit and range: share, 0 to 1. Origin: a spring of an independent simulator (seed 9501) that was named a counterbalance: 0.92.
    pub(crate) min_law_gain_share: f64,
    /// RMS residual of a joint with little left to explain. Unit and range: multiple of the noise floor, above 1. Origin: hand-set.
    pub(crate) max_floor_ratio_of_little_left: f64,
    /// How far the coefficient of a form of fixed gain may be from 1. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_gain_error: f64,
    /// Effects in one diagnosis; joints that warm up together count once. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) max_effects: usize,
    /// Cosine of the principal angle from which on two explanations are confounded. Unit and range: cosine, 0 to 1. Origin: hand-set.
    pub(crate) min_confounded_cosine: f64,
    /// The same where an effect may replace one of several groups of values. Unit and range: cosine, 0 to 1. Origin: hand-set.
    pub(crate) min_partly_confounded_cosine: f64,
    /// Log evidence by which an effect must be ahead of the values that it replaces. Unit and range: nats, above 0. Origin: sound arms with wrong values: none above 4.
    pub(crate) min_replacement_gain: f64,
    /// The same for friction of one direction. Unit and range: nats, above 0. Origin: sound arms: up to 18; true asymmetries of 86 cases are found before.
    pub(crate) min_one_sided_gain: f64,
    /// Effects that are tried as a whole explanation. Unit and range: count, above 0. Origin: cost.
    pub(crate) max_explanations_tried: usize,
    /// Candidates that are refined and tested on held-out blocks. Unit and range: count, above 0. Origin: cost.
    pub(crate) max_refined_candidates: usize,
    /// Family-wise chance of a candidate where no effect is. Unit and range: probability, 0 to 1. Origin: level of the test.
    pub(crate) max_false_alarm_rate: f64,
    /// Gain of a rival over the gain of the best. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_rival_gain_share: f64,
    /// Residual variance that a torque limit explains on its joint: the excess of the command is known exactly. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_saturation_share: f64,
    /// Held-out share by which an effect outweighs a simpler one. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_share_over_simplicity: f64,
    /// Angle error of an encoder that is mounted as encoders are. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) max_eccentricity_rad: f64,
    /// Amplitude of friction over the angle, over the level that comes with it. Unit and range: share, above 0. Origin: a sound arm's slow log: 0.13.
    pub(crate) min_friction_wave: f64,
    /// Relative difference of two orders of the angle that are the same. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_order_difference: f64,
    /// Held-out share of a joint's residual variance of a material structural effect. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_material_share: f64,
    /// The same on a joint near its noise floor. Unit and range: share, 0 to 1. Origin: sound arms near standstill: up to a sixth.
    pub(crate) min_material_share_at_floor: f64,
    /// The same at the floor with overwhelming evidence. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_material_share_if_plain: f64,
    /// Gain of log evidence that is overwhelming. Unit and range: nats, above 0. Origin: hand-set.
    pub(crate) overwhelming_gain: f64,
    /// Share of a joint's first residual variance that a further effect takes. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_share_of_first: f64,
    /// The same on a joint with a simulated gear, delay or bristle, which is never exact. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_share_beside_simulated: f64,
    /// Share of a joint's excess over its floor that its causes explain. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_explained_share: f64,
    /// The same of a simulated gear, delay or bristle. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_explained_share_simulated: f64,
    /// The same where more than noise remains. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_explained_share_above_noise: f64,
    /// RMS residual above which more than noise remains. Unit and range: multiple of the noise floor, above 1. Origin: hand-set.
    pub(crate) unexplained_floor_ratio: f64,
    /// RMS residual of a joint on which nothing remains. Unit and range: multiple of the noise floor, above 1. Origin: hand-set.
    pub(crate) max_floor_ratio_of_nothing_left: f64,
    /// Log evidence that a group of values must be worth to be wrong. Unit and range: nats, above 0. Origin: hand-set.
    pub(crate) min_group_evidence: f64,
    /// Log evidence of a counterbalance with values free, from which these may imitate it. Unit and range: nats, above 0. Origin: arms without one: below 0.
    pub(crate) min_counterbalance_doubt: f64,
    /// RMS residual with a body over that with the counterbalance, for both to explain as much. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_body_rms_ratio: f64,
    /// The same of one body at the flange against all links. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_flange_rms_ratio: f64,
    /// Share of a joint's gap that one body at the flange takes. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_body_gap_share: f64,
    /// Share of its gap by which the body may leave a joint worse. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_body_loss_share: f64,
    /// Share of the joint's friction above which a hysteresis is that friction. Unit and range: share, 0 to 1. Origin: bristles of three programs: 0.77 and more; hoses: less.
    pub(crate) min_own_friction_share: f64,
    /// Travel up to which a hysteresis is the turn of the joint's own friction. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) max_own_travel_rad: f64,
    /// Log evidence by which the frequency of a base is ahead of others. Unit and range: nats, above 0. Origin: hand-set.
    pub(crate) min_base_frequency_gain: f64,
    /// Share of its variance that a joint gives to a base that gives way. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_base_share: f64,
    /// Joints that must feel the base. Unit and range: count, above 0. Origin: one alone feels its own gear.
    pub(crate) min_joints_of_base: usize,
    /// Variance that a joint may lose with the base. Unit and range: share of what it keeps, 0 to 1. Origin: hand-set.
    pub(crate) max_base_loss: f64,
    /// Squared noise units for each value by which runs may fit shared values worse than their own. Unit and range: above 0. Origin: a third simulator's slow logs.
    pub(crate) max_shared_value_cost: f64,
    /// Size of a value below 0 that counts as 0, over the nominal one. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_negative_share: f64,
    /// Distance of a payload's centre from the last link's origin, over the reach. Unit and range: share, 0 to 1. Origin: measured arms: up to 0.11.
    pub(crate) max_payload_distance_share: f64,
}

/// What the held-out run must show for a cause to stand.
pub(crate) struct HeldOutTest {
    /// RMS residual in motion at or below which nothing is missing. Unit and range: multiple of the noise, above 1. Origin: sound arms: up to 1.9; named effects: 2.2 and more.
    pub(crate) max_sound_gap: f64,
    /// RMS residual in motion above which there is a gap. Unit and range: multiple of the noise, above 1. Origin: nominal models of sound arms: up to 1.6.
    pub(crate) min_gap_in_motion: f64,
    /// Squared torque that a cause takes there, over its own. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_transfer_share: f64,
    /// Share of what the others leave that an effect takes. Unit and range: share, 0 to 1. Origin: 75 cases: true causes 0.6 and more; a measured arm that nothing fits: up to 0.01.
    pub(crate) min_noticed_share: f64,
    /// The same of an effect that is judged in motion, whatever joints hold at rest. Unit and range: share, 0 to 1. Origin: more than half.
    pub(crate) min_most_share: f64,
    /// The same of an effect that is plain. Unit and range: share, 0 to 1. Origin: 47 of 51 true effects reach it.
    pub(crate) min_plain_share: f64,
    /// RMS residual without a plain effect. Unit and range: multiple of the noise, above 1. Origin: as above.
    pub(crate) min_plain_gap: f64,
    /// Share by which an effect of the whole arm may leave a joint worse. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_spoilt_share: f64,
    /// Squares in motion with an effect over those without it. Unit and range: share, 0 to 1. Origin: delays on sound arms with stiction: 1.0.
    pub(crate) max_helped_share: f64,
    /// Share of the nominal gap that an effect takes on a joint that it helps. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_taken_gap_share: f64,
    /// Relative error of a torque in another scale. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_scale_error: f64,
    /// Gap with all causes over the nominal gap, above which the fit is refuted. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_refuted_gap_ratio: f64,
    /// Measured shrink over the least that was predicted. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_kept_promise_share: f64,
    /// Predicted shrink from which on the rule above applies. Unit and range: share of the gap, 0 to 1. Origin: hand-set.
    pub(crate) min_promise: f64,
    /// Gap before over after, from which on a joint is closed whatever remains. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) min_closing_ratio: f64,
    /// Share of the gap of contact where other joints keep more than noise. Unit and range: share, 0 to 1. Origin: ringing gears take less.
    pub(crate) min_contact_share: f64,
    /// Gap before over after on an effect's own joint, which stays open. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) min_helping_ratio: f64,
    /// Predicted share of an effect that spoils a joint of its own. Unit and range: share of the gap, 0 to 1. Origin: true ones promised 0.03 and more.
    pub(crate) min_promised_share: f64,
    /// Residual with over without an effect on its own joint. Unit and range: ratio, above 1. Origin: true ones: at most 1.25.
    pub(crate) min_spoiling_factor: f64,
    /// Exact laws on one open joint that imitate something else. Unit and range: count, above 1. Origin: hand-set.
    pub(crate) min_crowd: usize,
    /// RMS residual in motion that measured arms keep with right values. Unit and range: multiple of the noise, above 1. Origin: a UR10e: up to 13.
    pub(crate) max_gap_with_right_values: f64,
    /// Share of the gap where wrong values are the answer. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_gap_share_beside_values: f64,
    /// The same on an arm whose joints mostly stay above their noise. Unit and range: share, 0 to 1. Origin: measured arms.
    pub(crate) max_gap_share_beside_values_open: f64,
    /// Share of the gap above the floor that may remain with wrong values. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_share_left: f64,
    /// Measured shrink over the upper end of an interval that holds 0. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_surprise_ratio: f64,
    /// Share of the gap of a refused effect that leaves nothing to name on its joint. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_refused_share: f64,
    /// Share of the gap of contact on an arm whose joints mostly stay open. Unit and range: share, 0 to 1. Origin: a KUKA without contact: 0.08; a pushed arm: 0.36; another program: 0.98.
    pub(crate) min_contact_share_open: f64,
    /// Shrink of a cause. Unit and range: share of the gap, 0 to 1. Origin: hand-set.
    pub(crate) min_cause_shrink: f64,
    /// Shrink of an effect, predicted or measured, unless it is plain. Unit and range: share of the gap, 0 to 1. Origin: hand-set.
    pub(crate) min_effect_shrink: f64,
    /// Shrink of a torque limit, predicted or measured. Unit and range: share of the gap, 0 to 1. Origin: true ones: 0.05 and more; a false one: 0.012.
    pub(crate) min_saturation_shrink: f64,
    /// Error of a body or rotor of this arm's file. Unit and range: multiple of its usual error, above 1. Origin: measured arms.
    pub(crate) max_usual_errors: f64,
    /// Identified over nominal rotor inertia of a rotor that is there. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_rotor_share: f64,
    /// Residual over torque of a model that is of this arm. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_torque_ratio: f64,
    /// Torque offset that is reported. Unit and range: multiple of a usual offset, above 1. Origin: 17 joints of another simulator: asymmetric friction 2.1 to 6.4.
    pub(crate) min_offset_over_usual: f64,
    /// Share of the squared residual that drag at the tool explains. Unit and range: share, 0 to 1. Origin: five simulated arms: 0.57 to 0.98; pushes: up to 0.22.
    pub(crate) min_drag_share: f64,
    /// Share of a force's squares that a load explains. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_load_share: f64,
    /// Time that a load stays. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) min_load_time_s: f64,
}

/// How often a cause of each kind is right. A probability each, 0 to 1, unless stated.
pub(crate) struct ConfidenceLevels {
    /// Least confidence in an adopted form. Unit and range: probability. Origin: hand-set.
    pub(crate) adopted_form: f64,
    /// Confidence in a value that was only refitted. Unit and range: probability. Origin: 11 of 23 drawn cases.
    pub(crate) refitted_value: f64,
    /// The same of drives that are off on several joints. Unit and range: probability. Origin: 135 of 142 causes on arms of two other programs.
    pub(crate) values_of_drives: f64,
    /// Joints from which on drives are off as a whole. Unit and range: count, above 1. Origin: as above.
    pub(crate) several_drives: usize,
    /// Factor for each confounded rival. Unit and range: probability. Origin: 15 of 19 drawn cases.
    pub(crate) first_of_class: f64,
    /// At most, where the held-out run does not show it plainly. Unit and range: probability. Origin: four true causes and two or three false ones in 75 cases.
    pub(crate) not_plain: f64,
    /// At most, for a law of the angle while another has evidence. Unit and range: probability. Origin: hand-set.
    pub(crate) another_law: f64,
    /// At most, for a small torque constant. Unit and range: probability. Origin: hand-set.
    pub(crate) may_be_bodies: f64,
    /// Torque constant that is small. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) small_gain: f64,
    /// At most, for an asymmetry together with friction with load. Unit and range: probability. Origin: hand-set.
    pub(crate) beside_load: f64,
    /// At most, where the measured shrink leaves the interval far behind. Unit and range: probability. Origin: hand-set.
    pub(crate) promise_broken: f64,
    /// Relative excess of a last link that may carry a load. Unit and range: share, above 0. Origin: hand-set.
    pub(crate) heavier_link: f64,
    /// At most, for structure on a joint that stays open. Unit and range: probability. Origin: hand-set.
    pub(crate) left_open: f64,
    /// At most, where there is such a joint. Unit and range: probability. Origin: hand-set.
    pub(crate) open_beside: f64,
    /// Below it a name is doubted. Unit and range: probability. Origin: as `may_take_nothing`.
    pub(crate) doubted: f64,
    /// Factor for a doubted name whose predicted shrink may be none. Unit and range: 1, 0 to 1. Origin: the independent simulator, seed
    /// 9301; tested on its seeds 9401 and 9101.
    pub(crate) may_take_nothing: f64,
    /// Of another mounting than the file's. Unit and range: probability. Origin: hand-set.
    pub(crate) mounting: f64,
    /// The same where another reading is confounded with it, or much remains. Unit and range: probability. Origin: hand-set.
    pub(crate) mounting_unsure: f64,
}

/// When a channel is not trusted.
pub(crate) struct Screening {
    /// Correlation of torque and speed below which the joint would generate energy. Unit and range: correlation, -1 to 0. Origin: hand-set.
    pub(crate) max_energy_correlation: f64,
    /// Correlation with the model's torque that excuses it. Unit and range: correlation, 0 to 1. Origin: hand-set.
    pub(crate) min_model_correlation: f64,
    /// Correlation with the model's torque below which its sign is wrong. Unit and range: correlation, -1 to 0. Origin: hand-set.
    pub(crate) max_opposite_correlation: f64,
    /// Torque over the model's, or its inverse, of another unit. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) min_unit_ratio: f64,
    /// Correlation of a torque that is the model's but for a factor. Unit and range: correlation, 0 to 1. Origin: hand-set.
    pub(crate) min_shape_correlation: f64,
    /// The ratio where the file has no friction. Unit and range: ratio, above 1. Origin: 150 kg on a KR300: 3.2.
    pub(crate) min_unit_ratio_without_friction: f64,
    /// The ratio where nearly all of the torque is friction. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) min_unit_ratio_of_friction: f64,
    /// Squares other than friction's over all, below which nearly all is friction. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_body_torque_share: f64,
    /// Squared residual of the better of load and other unit over that of the other one. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_load_residual_share: f64,
    /// Factor by which bodies and drive are both off. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) min_common_factor: f64,
    /// Relative difference of the two factors. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_factor_difference: f64,
    /// Share of the torque that each of the two makes. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_part_share: f64,
    /// Correlation with the whole model's torque. Unit and range: correlation, 0 to 1. Origin: hand-set.
    pub(crate) min_whole_correlation: f64,
    /// Torque steps that are reported, over its rms. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_torque_step_share: f64,
    /// Unknown speed that is reported. Unit and range: rad/s, above 0. Origin: hand-set.
    pub(crate) min_speed_blur_rad_s: f64,
    /// Variation of a silent channel over what friction and rotor take. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_silent_share: f64,
    /// Its correlation with the direction of motion. Unit and range: correlation, 0 to 1. Origin: hand-set.
    pub(crate) max_silent_correlation: f64,
    /// Variation over noise of a channel of noise alone. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_silent_noise_ratio: f64,
    /// Variation of such a channel over what friction and rotor take. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_noise_share: f64,
    /// Mean direction of a joint that turns one way. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_one_way_share: f64,
    /// Share of the torque to which a rigid arm is known. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) rigid_model_error: f64,
    /// Residual with a position turned over that as logged. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_turned_residual_share: f64,
    /// Residual with the position turned over that with the torque turned. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_turned_over_torque: f64,
    /// The same where torque runs against motion. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_flipped_residual_share: f64,
    /// Residual with the position turned. Unit and range: multiple of what is known, above 1. Origin: hand-set.
    pub(crate) max_flipped_residual: f64,
    /// Residual of a rigid arm that fits: no other reading is tried. Unit and range: multiple of what is known, above 1. Origin: hand-set.
    pub(crate) max_fitting_residual: f64,
    /// Residual of a torque against the other joint's model, over the torque. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_residual_of_other: f64,
    /// The same over the residual against its own joint. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_residual_over_own: f64,
    /// Product of these shares of both joints. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_residual_product: f64,
    /// Torque of a joint in one run over another of another unit. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) min_ratio_between_runs: f64,
    /// Ratio of its speeds and modelled torques in the two runs. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_use_ratio: f64,
    /// Gravity torque that a joint feels. Unit and range: multiple of what is known, above 1. Origin: hand-set.
    pub(crate) min_gravity: f64,
    /// Joints that must feel it. Unit and range: count, above 0. Origin: one alone may be balanced.
    pub(crate) min_gravity_joints: usize,
    /// Share of gravity in a torque that is compensated for it. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_gravity_share: f64,
    /// Residual without gravity over that as logged. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_weightless_residual_share: f64,
    /// Residual with two joints exchanged over that as logged. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_exchanged_residual_share: f64,
    /// Tilt of the base that is another mounting. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) min_tilt_rad: f64,
    /// Angle of a joint zero that is looked for. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) min_zero_rad: f64,
    /// Angle to an axis of the base at which it is that axis. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) max_axis_error_rad: f64,
    /// Residual with another gravity over that with the nominal one. Unit and range: share, 0 to 1. Origin: wrong values of bodies: up to 0.5.
    pub(crate) max_gravity_residual_share: f64,
    /// The same with another zero, of which there are more. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_zero_residual_share: f64,
    /// Residual over the other's at which both are confounded. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_rival_residual_ratio: f64,
    /// The same at which gravity is preferred. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_equal_residual_ratio: f64,
    /// Growth of a joint's gap in motion, over its torque. Unit and range: share, 0 to 1. Origin: gravity upside down with two zeros off: 0.8; wrong values and elastic gears: 0.02.
    pub(crate) max_gap_growth: f64,
    /// Angle to a quarter turn at which a zero is one. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) max_quarter_turn_error_rad: f64,
    /// Residual of the quarter turn over the best. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_quarter_turn_residual_ratio: f64,
    /// Residual of bodies along the desired motion of a computed torque. Unit and range: share, 0 to 1. Origin: no measured torque of a gear is that exact.
    pub(crate) max_computed_residual_share: f64,
    /// The same along the measured motion, of one joint. Unit and range: share, 0 to 1. Origin: as above.
    pub(crate) min_measured_residual_share: f64,
    /// Power of that joint's tracking error that stretches keep. Unit and range: share, 0 to 1. Origin: noise keeps less.
    pub(crate) min_slow_error_share: f64,
    /// Share of the squares that a body at the flange takes. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_flange_body_share: f64,
}

/// When torque is late, filtered, or of a delay.
pub(crate) struct Timing {
    /// Delay of a torque that is late. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) min_delay_s: f64,
    /// Part of a sample that is free in every fit. Unit and range: samples, 0 to 1. Origin: a command is held over its period.
    pub(crate) free_samples: f64,
    /// Standard deviations by which it is late. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) min_sigmas: f64,
    /// Change of the residual of a joint that counts. Unit and range: squared noise units, above 0. Origin: hand-set.
    pub(crate) min_joint_evidence: f64,
    /// Relative difference of a joint's delay from the arm's. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_disagreement: f64,
    /// The same where rows far from reversals do not decide: a clock has one time. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_clock_disagreement: f64,
    /// Joints that must agree. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) min_joints: usize,
    /// Share of the residual that the shift takes. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_residual_share: f64,
    /// Residual with a low-pass undone over that with a shift. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_filter_residual_share: f64,
    /// Time constant of such a low-pass: a faster one is a shift to the model filter. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) min_filter_s: f64,
    /// Share of the residual that the shift takes on a channel that is late by itself. Unit and range: share, 0 to 1. Origin: elastic gears and bristles look late as well.
    pub(crate) min_single_share: f64,
    /// RMS residual of that channel. Unit and range: multiple of the noise, above 1. Origin: as above.
    pub(crate) max_single_floor_ratio: f64,
    /// Difference between runs that agree. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) max_run_difference_s: f64,
    /// Relative standard deviation of a delay that is sized. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_size_error: f64,
    /// Delay that rows in motion allow, over the candidate's. Unit and range: share, 0 to 1. Origin: sound arms with stiction: up to 0.7; true delays: 1.
    pub(crate) min_allowed_share: f64,
    /// The same where a joint keeps several times its noise. Unit and range: share, 0 to 1. Origin: measured arms.
    pub(crate) min_allowed_share_open: f64,
    /// Speed of a row that shows time rather than the turn of friction. Unit and range: rad/s, above 0. Origin: hand-set.
    pub(crate) min_speed_rad_s: f64,
    /// The same over the joint's usual speed. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_speed_share: f64,
    /// Time for which filters keep the turn of friction. Unit and range: s, above 0. Origin: bristles of 0.2 mrad turn friction 28 ms late.
    pub(crate) turn_memory_s: f64,
    /// The same where filters are slower. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) slow_turn_memory_s: f64,
    /// Largest shift in time that is tried, either way. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) max_shift_s: f64,
    /// Rows of a joint for each of its columns. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) min_rows_per_column: usize,
}

/// What a log's samples must show to be spikes, jumps, held or frozen.
pub(crate) struct SignalFaults {
    /// Duration of a spike. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) max_spike_s: f64,
    /// The same in samples. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) max_spike_samples: usize,
    /// Height of a spike over the median around it, over the signal's range. Unit and range: share, above 0. Origin: hand-set.
    pub(crate) min_spike_share: f64,
    /// The same where the log is too slow to show how torque changes. Unit and range: share, above 0. Origin: hand-set.
    pub(crate) min_spike_share_slow: f64,
    /// The same over the usual deviation. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) min_spike_ratio: f64,
    /// Share of the samples that may be spikes. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_spike_samples_share: f64,
    /// Step of a jump over the step of all but a thousandth of the samples. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) min_jump_ratio: f64,
    /// Step of a jump. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) min_jump_rad: f64,
    /// Samples after which a glitch has ended. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) max_glitch_samples: usize,
    /// Time for which all channels repeat. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) min_frozen_s: f64,
    /// Steps in that time. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) min_frozen_samples: usize,
    /// Speed from which no joint stops at once. Unit and range: rad/s, above 0. Origin: hand-set.
    pub(crate) min_speed_before_frozen_rad_s: f64,
    /// Changes of a signal that is held between them. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) min_held_changes: usize,
    /// Share of these that are equally far apart. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_held_share: f64,
    /// Size of such a change: slower motion holds a step by itself. Unit and range: encoder steps, above 1. Origin: hand-set.
    pub(crate) min_change_in_steps: f64,
    /// Samples in a row at a torque limit. Unit and range: count, above 1. Origin: hand-set.
    pub(crate) min_flat_samples: usize,
    /// Share of all samples that such stretches make up. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_flat_share: f64,
    /// Samples at the limit over those a step below. Unit and range: ratio, above 1. Origin: a rounded torque that turns: 2.4.
    pub(crate) min_flat_ratio: f64,
    /// Speed of a joint at rest. Unit and range: rad/s, above 0. Origin: hand-set.
    pub(crate) max_still_speed_rad_s: f64,
    /// Time in motion of a joint that moves. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) min_motion_s: f64,
    /// Speed of a joint in training data. Unit and range: rad/s, above 0. Origin: hand-set.
    pub(crate) min_training_speed_rad_s: f64,
    /// Length of training data in which some joint moves. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) min_training_s: f64,
    /// Mean square of a row of a burst. Unit and range: squared usual residuals, above 1. Origin: hand-set.
    pub(crate) min_burst_power: f64,
    /// The same of a joint that feels it. Unit and range: squared usual residuals, above 1. Origin: hand-set.
    pub(crate) min_joint_burst_power: f64,
    /// Time at the ends of a run without bursts: the arm starts and stops. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) burst_edge_s: f64,
    /// Time between parts of one burst. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) max_burst_pause_s: f64,
    /// Share of the time in bursts. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_burst_time_share: f64,
    /// Travel of some joint in a stretch that repeats. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) min_repeated_span_rad: f64,
    /// Distance of positions that may repeat. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) max_repeat_distance_rad: f64,
    /// RMS distance of a stretch that repeats. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) max_repeat_rms_rad: f64,
    /// The same over the joint's span. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_repeat_rms_share: f64,
    /// Speed of rows that count: slower friction does not repeat. Unit and range: rad/s, above 0. Origin: hand-set.
    pub(crate) min_repeated_speed_rad_s: f64,
    /// Time in motion that repeats. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) min_repeated_s: f64,
}

/// What is believed of values and coefficients before the logs: standard deviations.
pub(crate) struct Priors {
    /// Of a body's mass and first moments. Unit and range: relative, above 0. Origin: CAD models.
    pub(crate) body: f64,
    /// Of a rotor inertia. Unit and range: relative, above 0. Origin: data sheets.
    pub(crate) rotor: f64,
    /// Of friction levels. Unit and range: relative, above 0. Origin: data sheets.
    pub(crate) friction: f64,
    /// Of a torque offset, over Coulomb friction. Unit and range: ratio, above 0. Origin: hand-set.
    pub(crate) offset: f64,
    /// The same where the file has no friction. Unit and range: ratio, above 0. Origin: a KUKA's second axis.
    pub(crate) offset_unmeasured: f64,
    /// Torque share of a value that the file gives as 0. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) missing_torque_share: f64,
    /// Torque share of a free coefficient. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) coefficient_torque_share: f64,
    /// Of a coefficient that is 1 by the physics. Unit and range: above 0. Origin: hand-set.
    pub(crate) unit_coefficient: f64,
    /// Of a link's scale: a link several times as heavy as drawn carries a payload. Unit and range: relative, above 0. Origin: hand-set.
    pub(crate) link_scale: f64,
    /// Log evidence that an inner value costs. Unit and range: nats, above 0. Origin: chosen among some twenty.
    pub(crate) inner_value_evidence: f64,
    /// Torque share of a contact force on the joint that feels it most. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) force_torque_share: f64,
    /// Distance of a contact from the last link. Unit and range: m, above 0. Origin: hand-set.
    pub(crate) min_contact_distance_m: f64,
    /// Of a group of values that is fixed, over its usual error. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) fixed_group_share: f64,
    /// Of a group that is free, at least, over its usual error. Unit and range: share, above 0. Origin: hand-set.
    pub(crate) min_free_group_share: f64,
    /// Change of held links with one body at the flange, over their usual error. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) held_link_share: f64,
    /// Of the time between torque and position. Unit and range: samples, above 0. Origin: a command is held over its period.
    pub(crate) timing_samples: f64,
    /// Of how softly friction changes sign, 0 being the model's. Unit and range: above 0. Origin: hand-set.
    pub(crate) friction_turn: f64,
    /// Torque share of a friction law of the ladder. Unit and range: share, above 0. Origin: regularisation.
    pub(crate) ladder_torque_share: f64,
    /// Error of a torque that nothing is known better than. Unit and range: share, 0 to 1. Origin: programs that differentiate in another way.
    pub(crate) min_torque_error_share: f64,
    /// Speed from which on the direction of friction is sure, with half a sample's change. Unit and range: rad/s, above 0. Origin: hand-set.
    pub(crate) min_sure_speed_rad_s: f64,
    /// Time after which a joint that stands holds one torque. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) max_held_torque_s: f64,
}

/// What effects of arms can be, and where they are looked for.
pub(crate) struct Plausibility {
    /// Travel over which bristles yield: less is a smeared stop. Unit and range: rad, above 0. Origin: false ones: 0.04 to 0.6 mrad; true ones in 257 cases: 2.4 mrad and more.
    pub(crate) min_bristle_travel_rad: f64,
    /// The same at most. Unit and range: rad, above 0. Origin: six degrees.
    pub(crate) max_bristle_travel_rad: f64,
    /// Error of a torque constant that is named. Unit and range: relative, above 0. Origin: hand-set.
    pub(crate) min_gain_error: f64,
    /// Squared cross stiffness of a spring over two joints, over the product of their own. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_cross_stiffness_share: f64,
    /// Command over the torque limit that cuts it. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) min_command_over_limit: f64,
    /// Time in motion in which a command is cut. Unit and range: share, 0 to 1. Origin: another simulator: 0.05 to 0.62.
    pub(crate) max_cut_time_share: f64,
    /// The same at least: fewer are single samples. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_cut_time_share: f64,
    /// Range of a joint with a torque over the angle. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) min_angle_law_range_rad: f64,
    /// Share of its range that a joint goes beyond where something pulls. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_pull_reach_share: f64,
    /// Twist of a gear. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) max_gear_twist_rad: f64,
    /// Time constant of a joint that warms up. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) min_warming_time_s: f64,
    /// The same at most. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) max_warming_time_s: f64,
    /// The same over the logged time: of more the log shows a straight line. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_warming_time_over_span: f64,
    /// Warmth at the start over that of lasting work. Unit and range: ratio, above 0. Origin: hand-set.
    pub(crate) max_start_warmth: f64,
    /// Logged time in which something may warm up. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) min_warming_record_s: f64,
    /// Mean speed of a joint that warms up by its own work. Unit and range: rad/s, above 0. Origin: hand-set.
    pub(crate) min_warming_speed_rad_s: f64,
    /// Angle between the axes of two modes of the base. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) min_mode_angle_rad: f64,
    /// Frequency of a mode over the model filter's cut-off. Unit and range: share, 0 to 1. Origin: the filter passes it.
    pub(crate) max_mode_cutoff_share: f64,
    /// Share of the base's acceleration that the mode makes: far below it the base follows the moment. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_mode_share: f64,
    /// Joints that one body at the flange must explain. Unit and range: count, above 1. Origin: hand-set.
    pub(crate) min_body_joints: usize,
    /// Distance of that body from the last link's origin, over the reach. Unit and range: share, above 0. Origin: hand-set.
    pub(crate) body_distance_share: f64,
    /// Friction over the file's that is unchanged. Unit and range: ratio, above 1. Origin: usual error of a file.
    pub(crate) max_friction_ratio_as_given: f64,
    /// Joints that are not those of the file. Unit and range: count, above 1. Origin: hand-set.
    pub(crate) min_strange_joints: usize,
    /// Share of its joint's squared gap of a value that the file gives as 0. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_unknown_value_share: f64,
    /// Posterior over prior deviation of a value that the runs determine. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_pinned_share: f64,
    /// Squared gap over the nominal one of values that are exported although a joint is further. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) max_written_gap_share: f64,
    /// Gap of that joint over its nominal one. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_written_joint_ratio: f64,
    /// Ratio of two gaps that are equal. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_equal_gap_ratio: f64,
    /// Squared gap of free values over that of consistent ones. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) max_free_gap_ratio: f64,
    /// Residual of the best pair of joints over that of the next. Unit and range: ratio, 0 to 1. Origin: hand-set.
    pub(crate) max_other_pair_ratio: f64,
    /// Residual of the best zero over that of every other joint's. Unit and range: ratio, 0 to 1. Origin: hand-set.
    pub(crate) max_other_zero_ratio: f64,
    /// Cycles over the joint's range of a ripple that may be a law of the angle. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) max_law_cycles: f64,
    /// RMS of a term of a lever law over that of the sum. Unit and range: ratio, above 1. Origin: nine ripples: 3.2 to 9.5; a drive that loses torque: 9.7.
    pub(crate) max_cancelling_ratio: f64,
    /// Cosine of the angle between a direction and gravity that are the same. Unit and range: cosine, 0 to 1. Origin: 8 degrees.
    pub(crate) min_gravity_cosine: f64,
    /// Change of friction for each watt that a robot file takes. Unit and range: 1/W, above 0. Origin: limit of robot.toml.
    pub(crate) max_friction_per_watt: f64,
    /// Highest order of the joint's angle. Unit and range: cycles per turn, above 0. Origin: teeth of gears.
    pub(crate) max_order: f64,
    /// Lowest order: below it friction and gravity do the same over the joint's range. Unit and range: cycles per turn, above 0. Origin: hand-set.
    pub(crate) min_order: f64,
    /// Ratio of two frequencies of a base that are not the same. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) min_frequency_ratio: f64,
}

/// How far a corrected model shrinks the gap, and how sure that is.
pub(crate) struct Prediction {
    /// Resamplings of the blocks. Unit and range: count, above 0. Origin: cost.
    pub(crate) resamplings: usize,
    /// 90 % quantile of what a drive's law is off by where friction has bristles and gears bend: in the interval of a value beside what the logs
    /// say. Unit and range: share of the value, 0 to 1. Origin: an independent simulator, seed 9401.
    pub(crate) drive_law_error: f64,
    /// Widening of the interval on either side. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) widening: f64,
    /// Factor on both sides of the interval of an effect's size: neither resamplings nor the posterior know errors of inner values and of the form. Unit
    /// and range: factor, at least 1. Origin: 90 % quantile of error over half-width on drawn cases (`docs/validation.md`, sizes).
    pub(crate) size_widening: f64,
    /// Time on either side in which the largest speed is a row's. Unit and range: s, above 0. Origin: memory of the model filter.
    pub(crate) speed_window_s: f64,
    /// Difference of the speeds of two motions of one kind, as a share of their time. Unit and range: share, 0 to 1. Origin: practice logs of two kinds: 0.45 to 0.8.
    pub(crate) max_speed_difference: f64,
    /// Widening on either side for each unit of that difference above it. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) widening_by_difference: f64,
    /// Length of a block of residuals. Unit and range: s, above 0. Origin: some ten times the correlation of residuals.
    pub(crate) block_s: f64,
    /// Blocks of a run. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) min_run_blocks: usize,
    /// Variation of the ratio between two runs. Unit and range: factor, above 1. Origin: hand-set.
    pub(crate) max_variation: f64,
    /// Rows that the residual at the next faster speed counts as. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) prior_rows: f64,
    /// Slowest bins of speed, below 0.01 rad/s, at which a joint stands. Unit and range: count, above 0. Origin: width of the bins.
    pub(crate) standing_speeds: usize,
    /// RMS torque that stiction holds, over the Coulomb friction, where no run shows it. Unit and range: share, above 0. Origin: measured UR10e 0.3 to 0.6, KUKA 1 to 1.7; simulators that stick 0.5 to 0.9.
    pub(crate) stiction_share: f64,
    /// Resamplings beyond either end of the interval. Unit and range: share, 0 to 0.5. Origin: interval of 90 %.
    pub(crate) tail: f64,
}

/// What is said and shown of where the gap lies.
pub(crate) struct Views {
    /// Time between rows that count as independent. Unit and range: s, above 0. Origin: residuals are correlated over a quarter of a second.
    pub(crate) independent_rows_s: f64,
    /// Independent stretches of a cell. Unit and range: count, above 0. Origin: hand-set.
    pub(crate) min_stretches: usize,
    /// Spread of a load or torque that is divided. Unit and range: multiple of the noise, above 0. Origin: hand-set.
    pub(crate) min_spread: f64,
    /// Range of a position that is divided. Unit and range: rad, above 0. Origin: hand-set.
    pub(crate) min_range_rad: f64,
    /// Ratio of two cells that is a contrast. Unit and range: ratio, above 1. Origin: hand-set.
    pub(crate) min_contrast: f64,
    /// Standard deviations by which it exceeds that ratio. Unit and range: count, above 0. Origin: some eighty pairs are compared.
    pub(crate) min_contrast_sigmas: f64,
    /// Squared gap of a joint that gets a sentence. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_gap_share: f64,
    /// Joints that a cause is shown on. Unit and range: count, above 0. Origin: space of the page.
    pub(crate) max_joints_shown: usize,
    /// Change of a joint's torque by a cause, over its largest, in units of the noise floor. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) min_shown_share: f64,
    /// Time around a change of direction that counts as reversal. Unit and range: s, above 0. Origin: hand-set.
    pub(crate) reversal_window_s: f64,
}

/// Limits of the motions that are proposed.
pub(crate) struct MotionDesign {
    /// Share of a joint's range that stays free at either end. Unit and range: share, 0 to 0.5. Origin: hand-set.
    pub(crate) range_margin: f64,
    /// Share of the rated speed that motions use. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) speed_share: f64,
    /// Share of the torque limit that motions use. Unit and range: share, 0 to 1. Origin: hand-set.
    pub(crate) torque_share: f64,
    /// Speed of a joint without a rated one. Unit and range: rad/s, above 0. Origin: hand-set.
    pub(crate) unrated_speed_rad_s: f64,
}

/// All of them.
pub(crate) struct Policy {
    pub(crate) adoption: Adoption,
    pub(crate) held_out: HeldOutTest,
    pub(crate) confidence: ConfidenceLevels,
    pub(crate) screening: Screening,
    pub(crate) timing: Timing,
    pub(crate) signal_faults: SignalFaults,
    pub(crate) priors: Priors,
    pub(crate) plausibility: Plausibility,
    pub(crate) motions: MotionDesign,
    pub(crate) views: Views,
    pub(crate) prediction: Prediction,
}

/// The policy in force.
pub(crate) const POLICY: Policy = Policy {
    adoption: Adoption {
        min_gain: [28.0, 40.0],
        min_delay_coefficient: 2.0 / 3.0,
        rival_gap: 12.0,
        min_law_gain_share: 0.85,
        max_floor_ratio_of_little_left: 1.2,
        max_gain_error: 0.4,
        max_effects: 4,
        min_confounded_cosine: 0.95,
        min_partly_confounded_cosine: 0.5,
        min_replacement_gain: 10.0,
        min_one_sided_gain: 25.0,
        max_explanations_tried: 6,
        max_refined_candidates: 7,
        max_false_alarm_rate: 0.05,
        min_rival_gain_share: 0.8,
        min_saturation_share: 0.8,
        min_share_over_simplicity: 0.1,
        max_eccentricity_rad: 0.02,
        min_friction_wave: 0.25,
        max_order_difference: 0.01,
        min_material_share: 0.1,
        min_material_share_at_floor: 0.3,
        min_material_share_if_plain: 0.15,
        overwhelming_gain: 100.0,
        min_share_of_first: 0.02,
        min_share_beside_simulated: 0.12,
        min_explained_share: 0.7,
        min_explained_share_simulated: 0.5,
        min_explained_share_above_noise: 0.85,
        unexplained_floor_ratio: 4.0,
        max_floor_ratio_of_nothing_left: 2.0,
        min_group_evidence: 4.0,
        min_counterbalance_doubt: 6.0,
        max_body_rms_ratio: 1.5,
        max_flange_rms_ratio: 1.1,
        min_body_gap_share: 0.5,
        max_body_loss_share: 0.1,
        min_own_friction_share: 0.75,
        max_own_travel_rad: 2e-3,
        min_base_frequency_gain: 10.0,
        min_base_share: 0.3,
        min_joints_of_base: 2,
        max_base_loss: 0.05,
        max_shared_value_cost: 6.0,
        max_negative_share: 0.1,
        max_payload_distance_share: 0.35,
    },
    held_out: HeldOutTest {
        max_sound_gap: 2.0,
        min_gap_in_motion: 4.0,
        min_transfer_share: 0.3,
        min_noticed_share: 0.25,
        min_most_share: 0.5,
        min_plain_share: 0.8,
        min_plain_gap: 2.0,
        min_spoilt_share: 0.1,
        max_helped_share: 0.9,
        min_taken_gap_share: 0.01,
        min_scale_error: 0.1,
        max_refuted_gap_ratio: 2.0,
        min_kept_promise_share: 0.1,
        min_promise: 0.1,
        min_closing_ratio: 7.0,
        min_contact_share: 0.05,
        min_helping_ratio: 1.5,
        min_promised_share: 0.005,
        min_spoiling_factor: 1.4,
        min_crowd: 2,
        max_gap_with_right_values: 20.0,
        max_gap_share_beside_values: 0.05,
        max_gap_share_beside_values_open: 0.25,
        max_share_left: 0.5,
        max_surprise_ratio: 2.0,
        min_refused_share: 0.5,
        min_contact_share_open: 0.25,
        min_cause_shrink: 0.01,
        min_effect_shrink: 0.002,
        min_saturation_shrink: 0.03,
        max_usual_errors: 8.0,
        min_rotor_share: 0.15,
        max_torque_ratio: 2.0,
        min_offset_over_usual: 3.5,
        min_drag_share: 0.4,
        min_load_share: 0.9,
        min_load_time_s: 4.0,
    },
    confidence: ConfidenceLevels {
        adopted_form: 0.9,
        refitted_value: 0.5,
        values_of_drives: 0.95,
        several_drives: 3,
        first_of_class: 0.8,
        not_plain: 0.6,
        another_law: 0.4,
        may_be_bodies: 0.6,
        small_gain: 0.04,
        beside_load: 0.45,
        promise_broken: 0.6,
        heavier_link: 0.3,
        left_open: 0.45,
        open_beside: 0.6,
        doubted: 0.8,
        may_take_nothing: 0.5,
        mounting: 0.97,
        mounting_unsure: 0.58,
    },
    screening: Screening {
        max_energy_correlation: -0.3,
        min_model_correlation: 0.5,
        max_opposite_correlation: -0.7,
        min_unit_ratio: 3.0,
        min_shape_correlation: 0.9,
        min_unit_ratio_without_friction: 5.0,
        min_unit_ratio_of_friction: 10.0,
        min_body_torque_share: 0.05,
        max_load_residual_share: 0.7,
        min_common_factor: 1.8,
        max_factor_difference: 0.1,
        min_part_share: 0.2,
        min_whole_correlation: 0.985,
        min_torque_step_share: 0.05,
        min_speed_blur_rad_s: 3e-3,
        max_silent_share: 1e-3,
        max_silent_correlation: 0.3,
        max_silent_noise_ratio: 1.2,
        max_noise_share: 0.2,
        min_one_way_share: 0.9,
        rigid_model_error: 0.02,
        max_turned_residual_share: 0.5,
        max_turned_over_torque: 0.6,
        max_flipped_residual_share: 0.97,
        max_flipped_residual: 2.0,
        max_fitting_residual: 1.5,
        max_residual_of_other: 0.5,
        max_residual_over_own: 0.5,
        max_residual_product: 0.1,
        min_ratio_between_runs: 20.0,
        max_use_ratio: 4.0,
        min_gravity: 3.0,
        min_gravity_joints: 2,
        max_gravity_share: 0.25,
        max_weightless_residual_share: 0.4,
        max_exchanged_residual_share: 0.25,
        min_tilt_rad: 0.6,
        min_zero_rad: 0.2,
        max_axis_error_rad: 0.26,
        max_gravity_residual_share: 0.6,
        max_zero_residual_share: 0.4,
        max_rival_residual_ratio: 1.5,
        max_equal_residual_ratio: 1.05,
        max_gap_growth: 0.1,
        max_quarter_turn_error_rad: 0.05,
        max_quarter_turn_residual_ratio: 1.1,
        max_computed_residual_share: 0.002,
        min_measured_residual_share: 0.01,
        min_slow_error_share: 0.5,
        min_flange_body_share: 0.9,
    },
    timing: Timing {
        min_delay_s: 1e-3,
        free_samples: 0.5,
        min_sigmas: 4.0,
        min_joint_evidence: 16.0,
        max_disagreement: 0.4,
        max_clock_disagreement: 0.1,
        min_joints: 2,
        min_residual_share: 0.02,
        max_filter_residual_share: 0.8,
        min_filter_s: 0.005,
        min_single_share: 0.8,
        max_single_floor_ratio: 2.0,
        max_run_difference_s: 1e-3,
        max_size_error: 0.02,
        min_allowed_share: 0.75,
        min_allowed_share_open: 0.2,
        min_speed_rad_s: 0.05,
        min_speed_share: 0.5,
        turn_memory_s: 0.1,
        slow_turn_memory_s: 0.2,
        max_shift_s: 0.05,
        min_rows_per_column: 4,
    },
    signal_faults: SignalFaults {
        max_spike_s: 0.003,
        max_spike_samples: 3,
        min_spike_share: 0.5,
        min_spike_share_slow: 2.0,
        min_spike_ratio: 20.0,
        max_spike_samples_share: 0.01,
        min_jump_ratio: 10.0,
        min_jump_rad: 5e-3,
        max_glitch_samples: 5,
        min_frozen_s: 0.015,
        min_frozen_samples: 5,
        min_speed_before_frozen_rad_s: 0.02,
        min_held_changes: 200,
        min_held_share: 0.9,
        min_change_in_steps: 3.0,
        min_flat_samples: 5,
        min_flat_share: 0.005,
        min_flat_ratio: 5.0,
        max_still_speed_rad_s: 0.02,
        min_motion_s: 0.5,
        min_training_speed_rad_s: 0.02,
        min_training_s: 3.0,
        min_burst_power: 25.0,
        min_joint_burst_power: 9.0,
        burst_edge_s: 1.0,
        max_burst_pause_s: 0.3,
        max_burst_time_share: 0.6,
        min_repeated_span_rad: 0.05,
        max_repeat_distance_rad: 0.01,
        max_repeat_rms_rad: 1e-3,
        max_repeat_rms_share: 0.005,
        min_repeated_speed_rad_s: 0.02,
        min_repeated_s: 3.0,
    },
    priors: Priors {
        body: 0.08,
        rotor: 0.12,
        friction: 0.25,
        offset: 0.03,
        offset_unmeasured: 0.1,
        missing_torque_share: 0.3,
        coefficient_torque_share: 0.3,
        unit_coefficient: 0.15,
        link_scale: 0.3,
        inner_value_evidence: 3.0,
        force_torque_share: 0.3,
        min_contact_distance_m: 0.05,
        fixed_group_share: 0.03,
        min_free_group_share: 1.0,
        held_link_share: 0.03,
        timing_samples: 0.5,
        friction_turn: 0.5,
        ladder_torque_share: 0.5,
        min_torque_error_share: 1e-3,
        min_sure_speed_rad_s: 3e-4,
        max_held_torque_s: 1.0,
    },
    plausibility: Plausibility {
        min_bristle_travel_rad: 1e-3,
        max_bristle_travel_rad: 0.1,
        min_gain_error: 0.02,
        min_cross_stiffness_share: 0.1,
        min_command_over_limit: 1.15,
        max_cut_time_share: 0.7,
        min_cut_time_share: 2e-4,
        min_angle_law_range_rad: 0.03,
        min_pull_reach_share: 0.1,
        max_gear_twist_rad: 0.5,
        min_warming_time_s: 20.0,
        max_warming_time_s: 7200.0,
        max_warming_time_over_span: 2.0,
        max_start_warmth: 4.0,
        min_warming_record_s: 90.0,
        min_warming_speed_rad_s: 0.01,
        min_mode_angle_rad: 1.0,
        max_mode_cutoff_share: 0.9,
        min_mode_share: 0.1,
        min_body_joints: 3,
        body_distance_share: 0.15,
        max_friction_ratio_as_given: 1.25,
        min_strange_joints: 3,
        min_unknown_value_share: 0.75,
        max_pinned_share: 0.5,
        max_written_gap_share: 0.5,
        max_written_joint_ratio: 1.25,
        max_equal_gap_ratio: 1.05,
        max_free_gap_ratio: 1.05,
        max_other_pair_ratio: 0.7,
        max_other_zero_ratio: 0.7,
        max_law_cycles: 4.0,
        max_cancelling_ratio: 3.0,
        min_gravity_cosine: 0.99,
        max_friction_per_watt: 1e5,
        max_order: 420.0,
        min_order: 4.0,
        min_frequency_ratio: 1.3,
    },
    prediction: Prediction {
        resamplings: 40,
        widening: 0.02,
        drive_law_error: 0.008,
        size_widening: 3.0,
        speed_window_s: 0.03,
        max_speed_difference: 0.35,
        widening_by_difference: 0.5,
        block_s: 2.5,
        min_run_blocks: 4,
        max_variation: 5.0,
        prior_rows: 10.0,
        standing_speeds: 3,
        stiction_share: 0.6,
        tail: 0.05,
    },
    views: Views {
        independent_rows_s: 0.5,
        min_stretches: 6,
        min_spread: 4.0,
        min_range_rad: 0.1,
        min_contrast: 1.5,
        min_contrast_sigmas: 3.5,
        min_gap_share: 0.05,
        max_joints_shown: 3,
        min_shown_share: 0.2,
        reversal_window_s: 0.15,
    },
    motions: MotionDesign { range_margin: 0.08, speed_share: 0.5, torque_share: 0.75, unrated_speed_rad_s: 1.0 },
};
