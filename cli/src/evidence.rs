//! What `rivet identify` says about its own result: is it biased, and can an arm be built like this?

use rivet_config::Robot;
use rivet_estimation::consistency::{ConsistencyError, Projection};
use rivet_estimation::offline::Bias;
use serde_json::{Value, json};

use crate::table::{number, paragraph};

/// Below this probability, chance is no explanation.
const SIGNIFICANT: f64 = 0.01;

/// Two lines on bias, for people.
pub(crate) fn bias_text(bias: &Bias) -> String {
    let p = if bias.p_value < 1e-12 { "p < 1e-12".to_owned() } else { format!("p = {}", number(bias.p_value, 2)) };
    let meaning = if bias.degrees == 0 {
        "regressor and instruments are the same: nothing to compare"
    } else if bias.p_value < SIGNIFICANT {
        "LS and IV differ by more than torque noise: position noise pulls LS, or the model lacks an effect"
    } else {
        "LS and IV differ by no more than torque noise: no sign of bias in LS"
    };
    let statistic =
        format!("{meaning} (Durbin-Wu-Hausman H = {}, {} free, {p})", number(bias.hausman, 3), bias.degrees);
    let ratio = if bias.ratio.is_empty() {
        "not known with delayed instruments, which differ from the regressor by motion".to_owned()
    } else {
        let each: Vec<String> = bias.ratio.iter().map(|r| number(*r, 2)).collect();
        format!(
            "noise that pulls LS over what IV keeps of it, per joint: {} (below 3: tracking error outweighs the noise)",
            each.join(" ")
        )
    };
    paragraph("bias of LS: ", &statistic) + &paragraph("bias left in IV: ", &ratio)
}

pub(crate) fn bias_json(bias: &Bias) -> Value {
    // An infinite ratio, of instruments equal to the regressor, is null in JSON.
    json!({
        "hausman": bias.hausman,
        "degrees_of_freedom": bias.degrees,
        "p_value": bias.p_value,
        "instrument_ratio": bias.ratio,
    })
}

/// What physical consistency costs, for people.
pub(crate) fn consistency_text(consistent: &Result<Projection, ConsistencyError>) -> String {
    let text = match consistent {
        Ok(found) => {
            let each: Vec<String> = found.torque_rms.iter().map(|rms| number(*rms, 2)).collect();
            let mut text = format!(
                "nearest arm that can be built changes torque by {} % rms ({} N m per joint)",
                number(found.torque_percent, 2),
                each.join(" ")
            );
            if found.distance > 1.0 {
                text += "; more than the noise explains, so effects the model lacks are in the values";
            }
            if !found.thickened.is_empty() {
                text += "; nominal bodies without extent in some direction were given one: ";
                text += &found.thickened.join(", ");
            }
            text
        }
        Err(why) => format!("no physically consistent set: {why}"),
    };
    paragraph("physical consistency: ", &text)
}

pub(crate) fn consistency_json(robot: &Robot, consistent: &Result<Projection, ConsistencyError>) -> Value {
    let (model, base) = (&robot.model, &robot.base);
    match consistent {
        Ok(found) => {
            let named = |(i, value): (usize, &f64)| json!({"name": base.name(model, i), "value": value});
            let standard = |(p, value): (&rivet_dynamics::Parameter, &f64)| json!({"name": p.name(&model.arm), "unit": p.unit(&model.arm), "value": value});
            json!({
                "torque_percent": found.torque_percent,
                "torque_rms": found.torque_rms,
                "distance": found.distance,
                "smallest_eigenvalue": found.smallest_eigenvalue,
                "iterations": found.iterations,
                "gamma": found.gamma,
                "thickened": found.thickened,
                "base": found.base.iter().enumerate().map(named).collect::<Vec<_>>(),
                "standard": model.parameters.iter().zip(&found.standard).map(standard).collect::<Vec<_>>(),
            })
        }
        Err(why) => json!({"error": why.to_string()}),
    }
}
