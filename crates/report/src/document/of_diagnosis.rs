//! The document of what the library found.

use rivet_diagnosis::{self as diagnosis, Diagnosis};

use super::{
    Cause, Cell, Curve, DataUse, Document, Excerpt, Figures, Gap, JointGap, Left, LogFinding, Number, Order, Parameter,
    Passport, Point, SCHEMA, Shrink, Stage,
};

/// Digits that figures of verdicts keep after the point, and digits that curves keep.
const DECIMALS: f64 = 1e9;
const CURVE_DIGITS: i32 = 5;

pub(crate) fn number(x: f64) -> Number {
    x.is_finite().then(|| (x * DECIMALS).round() / DECIMALS)
}

/// A point of a curve: finite, with as many digits as a drawing can show.
fn short(x: f64) -> f64 {
    if x == 0.0 || !x.is_finite() {
        return 0.0;
    }
    let unit = 10.0_f64.powi(CURVE_DIGITS - 1 - x.abs().log10().floor() as i32);
    (x * unit).round() / unit
}

fn shorts(x: &[f64]) -> Vec<f64> {
    x.iter().map(|v| short(*v)).collect()
}

impl Document {
    /// The document of a diagnosis of `robot`.
    pub fn new(robot: &str, found: &Diagnosis, passport: Option<Passport>) -> Document {
        let mut per_joint: Vec<JointGap> = found.per_joint.iter().map(JointGap::new).collect();
        for (gap, line) in per_joint.iter_mut().zip(found.details.iter().flat_map(|d| &d.ledger)) {
            gap.torque_nm = number(line.torque);
            gap.before_nm = number(line.before);
            gap.after_nm = number(line.after);
            gap.noise_floor_nm = number(line.floor);
            gap.bias_before_nm = number(line.bias_before);
            gap.bias_after_nm = number(line.bias_after);
            gap.peak_before_nm = number(line.peak_before);
            gap.peak_after_nm = number(line.peak_after);
        }
        Document {
            schema: SCHEMA.to_owned(),
            robot: robot.to_owned(),
            verdict: found.verdict.name().to_owned(),
            gap: Gap {
                before: number(found.before),
                after: number(found.after),
                noise_floor: number(found.noise_floor),
                per_joint,
            },
            place: found.place.iter().map(Cell::new).collect(),
            causes: found.causes.iter().map(Cause::new).collect(),
            log: found.log.iter().map(LogFinding::new).collect(),
            hints: found.withdrawn.iter().map(Cause::new).collect(),
            unexplained_share: number(found.unexplained_share),
            creeping_share: number(found.creeping_share),
            data: DataUse {
                runs: found.data.runs,
                cut: found.data.cut,
                fit_seconds: number(found.data.fit_seconds),
                sealed_seconds: number(found.data.sealed_seconds),
                of_another_kind: found.data.of_another_kind.and_then(number),
                unused: found.unused.clone(),
            },
            remark: found.remark.clone(),
            left_out: found.left_out.clone(),
            refuted: found.refuted,
            between_runs: found.between_runs.map(|between| between.name().to_owned()),
            other_arm: found.other_arm.clone(),
            passport,
            figures: found.details.as_ref().map(Figures::new),
            export: Vec::new(),
            self_check: None,
            rollout: None,
        }
    }
}

impl JointGap {
    fn new(gap: &diagnosis::JointGap) -> JointGap {
        JointGap {
            joint: gap.joint.clone(),
            before: number(gap.before),
            after: number(gap.after),
            noise_floor: number(gap.noise_floor),
            in_motion: match gap.in_motion {
                Some(times) if gap.noise_floor.is_finite() => times.map(number).to_vec(),
                _ => Vec::new(),
            },
            torque_nm: None,
            before_nm: None,
            after_nm: None,
            noise_floor_nm: None,
            floor_from: gap.noise_floor.is_finite().then(|| {
                let from = if gap.is_floor_from_repeats() { "repeats" } else { "signal" };
                from.to_owned()
            }),
            repeats_nm: gap.repeats.and_then(|repeats| number(repeats.torque)),
            repeats_s: gap.repeats.and_then(|repeats| number(repeats.seconds)),
            bias_before_nm: None,
            bias_after_nm: None,
            peak_before_nm: None,
            peak_after_nm: None,
        }
    }
}

impl Cell {
    fn new(cell: &diagnosis::Cell) -> Cell {
        Cell {
            joint: cell.joint.clone(),
            regime: cell.regime.name().to_owned(),
            share: number(cell.share),
            seconds: number(cell.seconds),
            known: cell.is_known(),
            before_nm: number(cell.before_nm),
            after_nm: number(cell.after_nm),
        }
    }
}

impl Cause {
    fn new(cause: &diagnosis::Cause) -> Cause {
        Cause {
            effect: cause.effect.name().to_owned(),
            joints: cause.joints.clone(),
            magnitude: cause.magnitude.iter().map(|(name, value)| (name.clone(), number(*value))).collect(),
            magnitude_interval: cause.intervals.iter().cloned().collect(),
            shrink: Shrink {
                predicted: number(cause.shrink.predicted),
                low: number(cause.shrink.low),
                high: number(cause.shrink.high),
                measured: number(cause.shrink.measured),
            },
            share: cause.share.and_then(number),
            p_value: cause.p_value.and_then(number),
            confidence: number(cause.confidence),
            indistinguishable_from: cause.indistinguishable_from.iter().map(|e| e.name().to_owned()).collect(),
            angles_deg: cause.angles.iter().map(|angle| number(angle.to_degrees())).collect(),
            separating_motion: cause.separating_motion.clone(),
            curves: cause.curves.iter().map(Curve::new).collect(),
            impossible: cause.impossible.clone(),
        }
    }
}

impl Curve {
    fn new(curve: &diagnosis::Curve) -> Curve {
        let (name, unit) = curve.variable.label();
        let point = |p: &diagnosis::Point| Point {
            at: short(p.at),
            without: short(p.without),
            spread: p.spread.map(short),
            with: short(p.with),
            cause: short(p.cause),
            rows: p.rows,
        };
        Curve {
            joint: curve.joint.clone(),
            variable: name.to_owned(),
            unit: unit.to_owned(),
            along_motion: curve.variable.along_motion(),
            rms_nm: number(curve.rms_nm),
            points: curve.points.iter().map(point).collect(),
        }
    }
}

impl LogFinding {
    fn new(found: &diagnosis::LogFinding) -> LogFinding {
        LogFinding {
            run: found.run.clone(),
            joint: found.joint.clone(),
            fault: found.fault.name().to_owned(),
            value: number(found.fault.value()),
            text: found.fault.text(),
        }
    }
}

impl Figures {
    fn new(details: &diagnosis::Details) -> Figures {
        Figures {
            stages: details.stages.iter().map(Stage::new).collect(),
            left: details.left.iter().map(Left::new).collect(),
            excerpts: details.excerpts.iter().map(Excerpt::new).collect(),
            views: Some(crate::Views::new(&details.views)),
            parameters: details.parameters.iter().map(Parameter::new).collect(),
            nominal_error: number(details.nominal_error),
        }
    }
}

impl Stage {
    fn new(stage: &diagnosis::Stage) -> Stage {
        Stage {
            effect: stage.effect.map(|e| e.name().to_owned()),
            joints: stage.joints.clone(),
            upheld: stage.upheld,
            predicted: number(stage.predicted),
            low: number(stage.low),
            high: number(stage.high),
            measured: number(stage.measured),
        }
    }
}

impl Left {
    fn new(left: &diagnosis::Leftover) -> Left {
        let order =
            |o: &diagnosis::Order| Order { order: short(o.order), after: short(o.after), before: short(o.before) };
        Left {
            joint: left.joint.clone(),
            above_noise: number(left.above_noise),
            lag_s: left.lag_s,
            autocorrelation: shorts(&left.autocorrelation),
            white: short(left.white),
            frequencies_hz: shorts(&left.frequencies),
            density_after: shorts(&left.density_after),
            density_before: shorts(&left.density_before),
            orders: left.orders.iter().map(order).collect(),
            correlation: shorts(&left.correlation),
        }
    }
}

impl Excerpt {
    fn new(excerpt: &diagnosis::Excerpt) -> Excerpt {
        Excerpt {
            joint: excerpt.joint.clone(),
            from_s: short(excerpt.from_s),
            step_s: excerpt.step_s,
            measured: shorts(&excerpt.measured),
            given: shorts(&excerpt.given),
            with_causes: shorts(&excerpt.with_causes),
            standstill_s: excerpt.standstill_s.iter().map(|span| span.map(short)).collect(),
        }
    }
}

impl Parameter {
    fn new(line: &diagnosis::ParameterLine) -> Parameter {
        Parameter {
            name: line.name.clone(),
            unit: line.unit.to_owned(),
            joint: line.joint.map(|j| j + 1),
            given: number(line.given),
            found: number(line.found),
            low: number(line.low),
            high: number(line.high),
            state: line.state.name().to_owned(),
            wrong: line.wrong,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_curves_keep_five_digits_and_stay_finite() {
        assert_eq!(
            [short(123.456789), short(-1.2345678e-7), short(f64::NAN), short(0.0)],
            [123.46, -1.2346e-7, 0.0, 0.0]
        );
    }
}
