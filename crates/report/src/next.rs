//! What to do next, in a sentence.

use crate::document::{Cause, Document, is_contact};
use crate::words::{effect, figure, list};

/// What to do about torque that was computed.
pub(crate) const MEASURE: &str = "Log the torque that was measured, or motor currents (drive_gain, and torque_from = \"current\" where torque \
                       columns are there too).";

const WHOLE_TORQUE: &str = "Log the whole torque, gravity included (what the drive measures, not an effort or a command to which \
                            compensation is added), and diagnose anew.";

/// A position that is off by less than this share of itself is not worth a word.
const SCALED: f64 = 0.003;

/// Beside values so much that is explained by nothing is worth a word.
const OPEN: f64 = 0.25;

/// Faults of a torque signal that come before anything else.
const UNSOUND: [&str; 4] = ["torque_sign", "torque_scale", "torque_silent", "torque_spikes"];

impl Document {
    /// What to do where the whole arm is otherwise than the file says.
    fn next_of_the_whole(&self) -> Option<String> {
        let again = "and diagnose the same logs again: nothing else was evaluated";
        if let Some([x, y, z]) = self.mounting() {
            let or = self.or("encoder_offset", "another joint zero (joint_zero) looks the same in these logs");
            return Some(format!(
                "Set gravity = [{x}, {y}, {z}] in the robot file, if the arm is mounted so, {again}{or}."
            ));
        }
        // A smaller offset is a value among others and is told without how far it is turned.
        let moved = |c: &&crate::Cause| c.effect == "encoder_offset" && c.magnitude.contains_key("turned_rad");
        let cause = self.causes.iter().find(moved)?;
        let offset = (*cause.magnitude.get("offset_rad")?)?;
        let or =
            self.or("gravity_direction", "an arm that is mounted otherwise (gravity) looks the same in these logs");
        Some(format!(
            "Add {offset:.4} rad ({:.1} degrees) to joint_zero of {} in [log] of the robot file, if its log uses \
             that zero, {again}{or}.",
            offset.to_degrees(),
            list(&cause.joints)
        ))
    }

    /// What else it may be, where the first cause is not told from it.
    fn or(&self, effect: &str, what: &str) -> String {
        let alike = self.causes.iter().any(|c| c.indistinguishable_from.iter().any(|other| other == effect));
        if alike { format!("; {what}") } else { String::new() }
    }

    /// What to do about signals of the wrong sign or scale where nothing was evaluated for them.
    pub(crate) fn next_of_signs(&self) -> Option<String> {
        let of = |names: &[&str]| {
            let mut joints: Vec<String> =
                self.log.iter().filter(|f| names.contains(&f.fault.as_str())).map(|f| f.joint.clone()).collect();
            joints.sort();
            joints.dedup();
            (!joints.is_empty()).then(|| list(&joints))
        };
        if let Some(joints) = of(&["position_sign"]) {
            return Some(format!(
                "Change the sign of the position of {joints}, or of the axis in the robot's URDF, and diagnose anew."
            ));
        }
        if of(&["torque_without_gravity"]).is_some() {
            return Some(WHOLE_TORQUE.to_owned());
        }
        if let Some(joints) = of(&["joints_exchanged"]) {
            return Some(format!(
                "Correct the order of the columns of {joints}, positions and torques, and diagnose the same logs \
                 again."
            ));
        }
        let joints = of(&["torque_sign", "torque_scale"])?;
        Some(format!(
            "Check sign, unit and scale of the torque of {joints}, and the sign of the position, before you use any \
             result."
        ))
    }

    /// What to look at where a position is best taken as another multiple of itself.
    fn scaled_position(&self) -> Option<String> {
        let gain = |hint: &Cause| hint.magnitude.get(Cause::POSITION_GAIN).copied().flatten();
        let off = |(_, gain): &(&Cause, f64)| (gain - 1.0).abs() > SCALED;
        let (hint, gain) = self.hints.iter().filter_map(|hint| Some((hint, gain(hint)?))).find(off)?;
        Some(format!(
            "Compare the position of {} with a known angle: torques fit best with {gain:.3} times the logged \
             position (a gear ratio, counts of an encoder). Then diagnose again.",
            list(&hint.joints)
        ))
    }

    /// What to look for where torque follows each reversal over an angle that is none of bristles.
    fn hysteresis(&self) -> Option<String> {
        let size = |hint: &Cause, name: &str| hint.magnitude.get(name).copied().flatten();
        let of = |hint| Some((hint, size(hint, Cause::HYSTERESIS)?, size(hint, "length_rad")?));
        let (hint, torque, length) = self.hints.iter().find_map(of)?;
        Some(format!(
            "Look for a hose, a cable or a seal that {} drags along: torques fit best with {} N m more against the \
             motion, built up over {} rad after each reversal.",
            list(&hint.joints),
            figure(torque, 3),
            figure(length, 2)
        ))
    }

    /// What to look at where torque is best taken with a constant more.
    fn constant(&self) -> Option<String> {
        let of = |hint: &Cause| hint.magnitude.get(Cause::CONSTANT).copied().flatten();
        let (hint, torque) = self.hints.iter().find_map(|hint| Some((hint, of(hint)?)))?;
        Some(format!(
            "Record the torque signal of {} with the drive off: torques fit best with {} N m more, at rest as in motion (a \
             zero offset, or [friction] offset in the robot file). Then diagnose again.",
            list(&hint.joints),
            figure(torque, 3)
        ))
    }

    pub(crate) fn next_line(&self) -> String {
        if self.has_computed() {
            return MEASURE.to_owned();
        }
        if self.log.iter().any(|f| f.fault == "torque_filtered") {
            return "Log the torque without its low-pass, or the positions through the same one.".to_owned();
        }
        if self.log.iter().any(|f| f.fault == "torque_swapped") {
            return "Exchange the swapped torque columns, and diagnose again.".to_owned();
        }
        let mut faults: Vec<String> =
            self.log.iter().filter(|f| UNSOUND.contains(&f.fault.as_str())).map(|f| f.joint.clone()).collect();
        if !faults.is_empty() {
            faults.sort();
            faults.dedup();
            return format!(
                "Check sign, unit and scale of the torque of {} before you use any other result.",
                list(&faults)
            );
        }
        let clocks =
            self.passport.iter().flat_map(|passport| &passport.inputs).filter_map(|input| input.clock.as_ref());
        if clocks.into_iter().any(|clock| clock.off.as_ref().is_some_and(|off| off.sure)) {
            return "Correct the clock of the logs first (see there), and diagnose again: a wrong clock looks like \
                    rotor inertia and friction."
                .to_owned();
        }
        if !self.other_arm.is_empty() {
            return "Check that the robot file and its URDF are those of the arm in the logs.".to_owned();
        }
        if let Some(next) = self.next_of_the_whole() {
            return next;
        }
        if let Some(next) = self.scaled_position().filter(|_| self.verdict != "no_gap") {
            return next;
        }
        if let Some(next) = self.hysteresis().filter(|_| self.verdict == "unexplained") {
            return next;
        }
        // Also beside a cause: it is the signal's, so it comes first.
        if let Some(next) = self.constant().filter(|_| self.verdict != "no_gap") {
            return next;
        }
        if self.needs_other_motion() {
            let order =
                if self.data.cut { "" } else { "; if one of these logs has such motion, give it before the others" };
            return format!("Record a motion that uses every joint over its range and speed{order}.");
        }
        if let Some((cause, motion)) = self.causes.iter().find_map(|c| Some((c, c.separating_motion.as_ref()?))) {
            let class = !cause.indistinguishable_from.is_empty();
            let how = if class { "; give that log before the others, since the last one is held out" } else { "" };
            return format!("To separate the causes, record {motion}{how}.");
        }
        if self.verdict == "unexplained" && self.between_runs.is_some() {
            if self.data.cut {
                return "Find what changed during the run (a load, a tool, a setting, a signal that failed), or \
                        diagnose the parts before and after it separately."
                    .to_owned();
            }
            return "Find what changed between the runs (a load, a tool, a setting), or diagnose each state of the \
                    arm separately: swap the logs, or use one log alone."
                .to_owned();
        }
        if self.causes.iter().any(is_contact) {
            // Nobody simulates a touch that no motion tells.
            let others: Vec<String> =
                self.causes.iter().filter(|c| !is_contact(c)).map(|c| effect(&c.effect)).collect();
            let rest = if others.is_empty() { String::new() } else { format!("; then correct {}", list(&others)) };
            return format!(
                "Find what touched the arm and keep it away, then record and diagnose a new run: a contact is not \
                 part of a simulator{rest}."
            );
        }
        match self.verdict.as_str() {
            "no_gap" => match self.late_ms() {
                Some(ms) => format!(
                    "Log torque and position of one instant, or move the torque columns by {ms} ms, before these logs identify \
                     anything: `rivet identify` and `rivet predict` take them as they are. The model itself may be used."
                ),
                None => "Use the model; record other motion to trust it further.".to_owned(),
            },
            "unexplained" => {
                "Check the residual by frequency, angle and joint; record each joint alone, slow and fast.".to_owned()
            }
            "parameter" => {
                let open = self.unexplained_share.filter(|share| *share >= OPEN && !self.is_fitted());
                let then = open.map_or_else(String::new, |share| {
                    format!("; they do not explain {:.0} % of the squared gap", 100.0 * share)
                });
                format!("Put the parameters found into the robot file and diagnose a new run{then}.")
            }
            _ => {
                let left: Vec<String> = self.left_joints().into_iter().map(|(joint, _)| joint).collect();
                let then = if left.is_empty() {
                    String::new()
                } else {
                    format!("; on {} something else is missing that nothing here names", list(&left))
                };
                let is_late = |effect: &String| ["current_loop_lag", "transport_delay"].contains(&effect.as_str());
                let late: Vec<&Cause> = self.causes.iter().filter(|c| is_late(&c.effect)).collect();
                let logged = if late.is_empty() {
                    ""
                } else {
                    "Check that positions are logged as they are measured: a low-pass or a delay of theirs looks \
                     like one of the drive. "
                };
                let either = if late.iter().any(|c| c.indistinguishable_from.iter().any(is_late)) {
                    "No motion of one joint is expected to separate a delay from a lag. A step of one drive's \
                     current, recorded at the drive's own rate, does (dead time, or a slope); for motion either \
                     serves. "
                } else {
                    ""
                };
                format!("{logged}{either}Add the effect to the simulator and diagnose a new run{then}.")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use crate::verdict::tests::{cause, document, line};

    #[test]
    fn what_would_separate_a_class_comes_before_the_logs_that_do_not() {
        let next = |rivals: Value| {
            let mut spring = cause("joint_spring", &json!({"stiffness_Nm_rad": 120.0}));
            spring["indistinguishable_from"] = rivals;
            spring["separating_motion"] = json!("the whole range");
            line(&document(&[("causes", json!([spring]))]), "Next")
        };
        assert!(next(json!(["counterbalance"])).contains("the whole range; give that log before the others"));
        assert_eq!(next(json!([])), "To separate the causes, record the whole range.");
    }

    #[test]
    fn a_delay_that_may_be_a_lag_sends_nobody_after_another_chirp() {
        let next = |rivals: Value, planned: Value| {
            let mut late = cause("transport_delay", &json!({"seconds": 0.008}));
            (late["indistinguishable_from"], late["separating_motion"]) = (rivals, planned);
            line(&document(&[("causes", json!([late]))]), "Next")
        };
        let told = next(json!(["current_loop_lag"]), json!(null));
        assert!(told.contains("current, recorded at the drive's own rate"), "{told}");
        assert!(told.contains("positions are logged as they are measured"), "{told}");
        assert!(next(json!(["current_loop_lag"]), json!("a chirp")).contains("record a chirp"), "one that does tell");
        assert!(!next(json!([]), json!(null)).contains("own rate"), "what is told apart");
    }

    #[test]
    fn another_mounting_says_what_to_write() {
        let found = json!({"turned_rad": 3.1, "gravity_x_m_s2": -0.0, "gravity_y_m_s2": 0.0, "gravity_z_m_s2": 9.81});
        let document =
            document(&[("verdict", json!("parameter")), ("causes", json!([cause("gravity_direction", &found)]))]);
        let (gap, next) = (line(&document, "Gap"), line(&document, "Next"));
        assert!(gap.contains("all else nominal") && next.contains("gravity = [0, 0, 9.81]"), "{gap} {next}");
    }

    #[test]
    fn parts_of_one_run_are_no_runs_to_swap() {
        let data = json!({"runs": 2, "cut": true, "fit_seconds": 10.0, "sealed_seconds": 5.0});
        for (refuted, between) in [(false, "sealed_differs"), (true, "sealed_as_given")] {
            let document = document(&[
                ("verdict", json!("unexplained")),
                ("refuted", json!(refuted)),
                ("between_runs", json!(between)),
                ("data", data.clone()),
            ]);
            let (cause, next) = (line(&document, "Cause"), line(&document, "Next"));
            assert!(cause.contains("omething changed during the run") && !cause.contains("between"), "{cause}");
            assert!(next.contains("during the run") && !next.contains("swap"), "{next}");
        }
    }

    #[test]
    fn a_zero_that_is_another_says_what_to_add_and_what_else_it_may_be() {
        let size = json!({"offset_rad": -std::f64::consts::FRAC_PI_2, "turned_rad": std::f64::consts::FRAC_PI_2});
        let mut zero = cause("encoder_offset", &size);
        zero["joints"] = json!(["shoulder"]);
        let next = |zero: &serde_json::Value| {
            line(&document(&[("verdict", json!("parameter")), ("causes", json!([zero]))]), "Next")
        };
        let alone = next(&zero);
        assert!(alone.starts_with("Add -1.5708 rad (-90.0 degrees) to joint_zero of shoulder in [log]"), "{alone}");
        assert!(!alone.contains("mounted"), "{alone}");
        zero["indistinguishable_from"] = json!(["gravity_direction"]);
        assert!(next(&zero).contains("mounted otherwise"), "{}", next(&zero));
        zero["magnitude"] = json!({"offset_rad": 0.05});
        assert!(!next(&zero).contains("joint_zero"), "a small one is a value among others: {}", next(&zero));
    }

    #[test]
    fn a_position_of_the_wrong_sign_says_what_to_do() {
        let fault = json!({"run": "a", "joint": "j", "fault": "position_sign", "value": 2.6, "text": ""});
        let told = document(&[("remark", json!("why")), ("log", json!([fault]))]);
        assert!(line(&told, "Next").starts_with("Change the sign of the position of j"), "{}", line(&told, "Next"));
    }
}
