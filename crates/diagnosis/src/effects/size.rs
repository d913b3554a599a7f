//! The reported sizes of an effect, by name with unit.

use crate::effects::form::{Form, force_components};
use crate::effects::two_mass::Gear;

/// Name of the phase of a wave.
const PHASE: &str = "phase_rad";

impl Form {
    /// Size by name with unit, from the coefficients `c` of its columns. `nominal` is the standard vector: that which was fitted for what
    /// warms up, that by which its column was made for bristles.
    pub(crate) fn magnitude(&self, c: &[f64], joints: usize, nominal: &[f64]) -> Vec<(String, f64)> {
        let named = |pairs: &[(&str, f64)]| pairs.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect();
        let wave = |c: &[f64]| c[0].hypot(c[1]);
        // Of `amplitude·cos(order·q − phase)`.
        let phase = |c: &[f64]| c[1].atan2(c[0]);
        if let Some(size) = self.friction_magnitude(c, joints, nominal) {
            return size;
        }
        match self {
            Form::PositionFriction { order, .. } | Form::Ripple { order, .. } => {
                named(&[("amplitude_Nm", wave(c)), (PHASE, phase(c)), ("cycles_per_turn", *order)])
            }
            Form::TransmissionError { order, .. } => {
                named(&[("amplitude_rad", wave(c)), (PHASE, phase(c)), ("cycles_per_turn", *order)])
            }
            Form::Eccentricity { .. } => named(&[("amplitude_rad", wave(c)), (PHASE, phase(c))]),
            // Measured torque over the model's: the drive delivers less than it reports when this is above 1.
            Form::Gain { .. } => named(&[("gain", 1.0 / (1.0 + c[0]))]),
            Form::TorqueLaw { .. } => named(&[("cubic_per_Nm2", c[0])]),
            Form::TwoMass { gear, .. } => gear_magnitude(gear),
            Form::Base { mode } => named(&[
                ("frequency_hz", mode.hz),
                ("damping_ratio", mode.damping),
                ("compliance_rad_Nm", mode.compliance(c[0])),
                ("axis_heading_rad", mode.heading),
            ]),
            Form::Spring { .. } => named(&[("stiffness_Nm_rad", c[0]), ("rest_angle_rad", -c[1] / c[0])]),
            Form::Counterbalance { .. } => named(&[("lever_torque_Nm", c[0]), ("free_length_torque_Nm", c[1])]),
            Form::Counterweight { .. } => named(&[("torque_Nm", wave(c)), ("zero_at_rad", -c[1].atan2(c[0]))]),
            Form::Pull { from, .. } => named(&[("from_rad", *from), ("rise_Nm_rad", c[0]), ("bend_Nm_rad2", c[1])]),
            Form::Softening { width, .. } => named(&[("most_Nm", c[0].abs()), ("rise_Nm_rad", c[0] / width)]),
            Form::AngleLaw { .. } => {
                named(&[("rise_Nm_rad", c[0]), ("bend_Nm_rad2", c[1]), ("hardening_Nm_rad3", c[2])])
            }
            Form::SpringBetween { .. } => {
                named(&[("first_Nm_rad", c[0]), ("second_Nm_rad", c[1]), ("between_Nm_rad", c[2])])
            }
            Form::Coupling { .. } => {
                named(&[("coulomb_Nm", c[0]), ("viscous_Nms_rad", c[1]), ("rotor_inertia_kgm2", c[2])])
            }
            Form::Delay { seconds } => named(&[("seconds", seconds * c[0])]),
            Form::Lag { .. } => {
                named(&[("time_constant_s", c[0]), ("bandwidth_hz", 1.0 / (std::f64::consts::TAU * c[0]))])
            }
            Form::Saturation { limit, .. } => named(&[("limit_Nm", *limit)]),
            Form::Constant { .. } => named(&[("constant_Nm", c[0])]),
            Form::PositionScale { .. } => named(&[("position_gain", 1.0 + c[0])]),
            Form::EncoderOffset { .. } => named(&[("offset_rad", c[0])]),
            // With fewer joints than numbers, one of the six stands for another.
            Form::Force { moment: true, .. } if joints < force_components(true) => Vec::new(),
            Form::Force { moment, .. } => force_magnitude(c, *moment),
            Form::Gravity => named(&[("tilt_rad", wave(c) / 9.81), ("gx_m_s2", c[0]), ("gy_m_s2", c[1])]),
            Form::Payload => named(&[
                ("mass_kg", c[0]),
                ("com_x_m", c[1] / c[0]),
                ("com_y_m", c[2] / c[0]),
                ("com_z_m", c[3] / c[0]),
            ]),
            Form::LinkScale { .. } => named(&[("mass_gain", 1.0 + c[0])]),
            Form::RotorInertia { joint } => {
                named(&[("inertia_gain", 1.0 + c[0] / nominal[10 * joints + joint].max(1e-12))])
            }
            Form::Coulomb { .. } => named(&[("change_Nm", c[0])]),
            Form::Viscous { .. } => named(&[("change_Nms_rad", c[0])]),
            // Friction laws have their size from above.
            Form::Asymmetry { .. }
            | Form::Hysteresis { .. }
            | Form::Load { .. }
            | Form::OneSided { .. }
            | Form::Presliding { .. }
            | Form::Stribeck { .. }
            | Form::Temperature { .. }
            | Form::ViscousNonlinearity { .. }
            | Form::Warming { .. } => Vec::new(),
        }
    }

    /// The same of a friction law of one joint; none of another effect.
    fn friction_magnitude(&self, c: &[f64], joints: usize, nominal: &[f64]) -> Option<Vec<(String, f64)>> {
        let named = |pairs: &[(&str, f64)]| pairs.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect();
        Some(match self {
            Form::Asymmetry { .. } => named(&[("coulomb_Nm", c[0]), ("viscous_Nms_rad", c[1])]),
            Form::OneSided { forwards: true, .. } => named(&[("forwards_Nm", c[0])]),
            Form::OneSided { forwards: false, .. } => named(&[("backwards_Nm", c[0])]),
            Form::Stribeck { velocity, .. } => named(&[("excess_Nm", c[0]), ("velocity_rad_s", *velocity)]),
            Form::ViscousNonlinearity { joint } => named(&[
                ("linear_Nms_rad", nominal[11 * joints + joint] + c[0]),
                ("quadratic_Nms2_rad2", c[1]),
                ("cubic_Nms3_rad3", c[2]),
            ]),
            Form::Load { .. } => named(&[("ratio", c[0])]),
            Form::Temperature { .. } => named(&[("viscous_Nms_rad_K", c[0]), ("coulomb_Nm_K", c[1])]),
            Form::Warming { joint, warmth } => {
                let friction = [nominal[11 * joints + joint], nominal[12 * joints + joint]];
                let [first, last] = warmth.ends(c, friction);
                let change = |first: f64, last: f64| 100.0 * (last - first) / first;
                let all = |at: [f64; 2]| at[0] * warmth.work[1] + at[1] * warmth.work[0];
                let mut size = named(&[
                    ("over_s", warmth.span_s),
                    ("time_constant_s", warmth.time_s),
                    ("friction_change_percent", change(all(first), all(last))),
                    ("viscous_change_Nms_rad", last[0] - first[0]),
                    ("coulomb_change_Nm", last[1] - first[1]),
                ]);
                for (k, name) in ["viscous_change_percent", "coulomb_change_percent"].into_iter().enumerate() {
                    if first[k] > 0.0 {
                        size.push((name.to_owned(), change(first[k], last[k])));
                    }
                }
                size
            }
            Form::Presliding { joint, length } => {
                let level = c[0] * nominal[12 * joints + joint].abs();
                named(&[("length_rad", *length), ("stiffness_Nm_rad", level / length)])
            }
            Form::Hysteresis { length, .. } => named(&[("hysteresis_Nm", c[0]), ("length_rad", *length)]),
            _ => return None,
        })
    }

    /// Whether the motion alone tells what the effect does: contact and saturation it does not.
    pub(crate) fn is_predictable(&self) -> bool {
        !matches!(self, Form::Force { .. } | Form::Saturation { .. })
    }

    /// Whether wrong values of the model can look like the effect: then the held-out gain over a refit of all values is
    /// small although the values it takes are absurd, and the evidence alone decides.
    pub(crate) fn hides(&self) -> bool {
        use crate::effects::effect::Kind;
        self.effect().kind() == Kind::Value
            || matches!(
                self,
                Form::Lag { .. }
                    | Form::Delay { .. }
                    | Form::Asymmetry { .. }
                    | Form::OneSided { .. }
                    | Form::Spring { .. }
                    | Form::Counterbalance { .. }
                    | Form::Counterweight { .. }
                    | Form::Constant { .. }
                    | Form::AngleLaw { .. }
                    | Form::Softening { .. }
                    | Form::SpringBetween { .. }
            )
    }
}

/// Stiffness of a gear, and its backlash where it has one.
fn gear_magnitude(gear: &Gear) -> Vec<(String, f64)> {
    let gap = (gear.gap > 0.0).then(|| ("gap_rad".to_owned(), gear.gap));
    gap.into_iter().chain([("stiffness_Nm_rad".to_owned(), gear.stiffness)]).collect()
}

/// Largest force, and moment, of contact with coefficients `c`.
fn force_magnitude(c: &[f64], moment: bool) -> Vec<(String, f64)> {
    let length = |c: &[f64]| c.iter().map(|x| x * x).sum::<f64>().sqrt();
    let hats = || c.chunks(force_components(moment));
    let mut size = vec![("largest_N".to_owned(), hats().map(|c| length(&c[..3])).fold(0.0, f64::max))];
    if moment {
        size.push(("largest_Nm".to_owned(), hats().map(|c| length(&c[3..])).fold(0.0, f64::max)));
    }
    size
}
