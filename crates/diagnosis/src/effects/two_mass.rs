//! Two-mass model of an elastic gear or backlash: the link's motion, simulated from the motor-side encoder and the model.
//!
//! With δ = q_link − q_motor of joint j and everything else rigid,
//!
//! ```text
//! M_jj δ̈ + G_jj δ + τ_rigid,j(q_motor) = s(δ, δ̇)        s: torque of the spring on the link
//! motor j carries s instead of τ_rigid,j;   joint i feels M_ij δ̈ + G_ij δ more
//! ```

use crate::effects::physics::Physics;
use crate::policy::POLICY;

/// A gear between motor and link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gear {
    /// \[N·m/rad\]
    pub(crate) stiffness: f64,
    /// Damping ratio at the joint's mean inertia.
    pub(crate) damping: f64,
    /// Whole play \[rad\].
    pub(crate) gap: f64,
}

/// Angle of the free oscillation that one step of the integration may cover \[rad\].
const MAX_GEAR_STEP_PHASE_RAD: f64 = 0.25;
/// Most steps in a sample: stiffer gears are rigid at the rate of the log.
const MOST_STEPS: f64 = 16.0;

/// Full-rate column of the torque change that a gear causes; nothing on all joints for one that no arm can have.
pub(crate) fn column(physics: &Physics<'_>, joint: usize, gear: Gear) -> Vec<Option<Vec<f64>>> {
    let (samples, period) = (physics.samples(), physics.period_s());
    let (mass, gradient) = (&physics.mass()[joint][joint], &physics.gradient()[joint][joint]);
    let rigid = &physics.rigid[joint];
    let mean = mass.iter().sum::<f64>() / samples.max(1) as f64;
    let damping = 2.0 * gear.damping * (gear.stiffness * mean.max(1e-9)).sqrt();
    let half = 0.5 * gear.gap;
    let angle = period * (gear.stiffness / mean.max(1e-9)).sqrt();
    let steps = (angle / MAX_GEAR_STEP_PHASE_RAD).ceil().clamp(1.0, MOST_STEPS) as usize;
    let h = period / steps as f64;
    let spring = |delta: f64, speed: f64| {
        let stretch = delta - delta.clamp(-half, half);
        if stretch == 0.0 && half > 0.0 { 0.0 } else { -gear.stiffness * stretch - damping * speed }
    };
    // At rest under the first load.
    let load = rigid.first().copied().unwrap_or(0.0);
    let mut delta = -load / gear.stiffness - half * load.signum();
    let mut speed = 0.0;
    let (mut deltas, mut accels) = (vec![0.0; samples], vec![0.0; samples]);
    let mut at_motor = vec![0.0; samples];
    for k in 0..samples {
        let inertia = mass[k].max(1e-3 * mean);
        let accel_of =
            |delta: f64, speed: f64, load: f64| (spring(delta, speed) - load - gradient[k] * delta) / inertia;
        // Softer than gravity the link falls over: there is no such arm.
        if delta.abs() > POLICY.plausibility.max_gear_twist_rad + half || delta.is_nan() {
            return vec![None; physics.joints()];
        }
        deltas[k] = delta;
        accels[k] = accel_of(delta, speed, rigid[k]);
        at_motor[k] = spring(delta, speed) - rigid[k];
        let rise = rigid.get(k + 1).map_or(0.0, |next| next - rigid[k]);
        for step in 0..steps {
            // Semi-implicit Euler keeps the energy of a stiff spring bounded. The load goes on between samples: held, it
            // would be a delay.
            let load = rigid[k] + rise * (step as f64 + 0.5) / steps as f64;
            speed += h * accel_of(delta, speed, load);
            delta += h * speed;
        }
    }
    (0..physics.joints())
        .map(|i| {
            if i == joint {
                return Some(at_motor.clone());
            }
            let (mass, gradient) = (&physics.mass()[joint][i], &physics.gradient()[joint][i]);
            Some((0..samples).map(|k| mass[k] * accels[k] + gradient[k] * deltas[k]).collect())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::nominal::{Nominal, Typical};
    use crate::model::run::{Motion, Run};
    use rivet_dynamics::{Arm, Model, Structure};

    /// One link of inertia 2 kg m² about a vertical axis, so that gravity does nothing.
    const URDF: &str = r#"<robot name="one"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 0"/>
        <mass value="1"/><inertia ixx="2" iyy="2" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
        <limit lower="-3" upper="3" velocity="5" effort="100"/></joint></robot>"#;

    fn change(hz: f64, gear: Gear) -> (Vec<f64>, Vec<f64>) {
        let arm = Arm::from_urdf(URDF, [0.0, 0.0, -9.81]).expect("a sound arm");
        let model = Model::new(arm, Structure { sign_velocity: 0.01, ..Structure::default() });
        let mut x = vec![0.0; model.len()];
        x[..10].copy_from_slice(&model.arm.links[0]);
        let omega = std::f64::consts::TAU * hz;
        let q: Vec<f64> = (0..6000).map(|k| 0.3 * (omega * f64::from(k) * 1e-3).sin()).collect();
        let tau = vec![vec![0.0; q.len()]];
        let run = Run { name: String::new(), period_s: 1e-3, tau, q: vec![q], ..Run::default() };
        let nominal = Nominal::new(&model, &x, &Typical::from_runs(std::slice::from_ref(&run), 1));
        let motion = Motion::from_run(&run);
        let physics = Physics::new(&run, &motion, &nominal, &nominal.x);
        let column = column(&physics, 0, gear).remove(0).expect("the joint itself changes");
        (physics.rigid[0].clone(), column)
    }

    /// A sine of frequency ω through a spring: the motor carries `J q̈ / (1 − ω²J/k)` instead of `J q̈`.
    #[test]
    fn a_spring_amplifies_as_the_closed_form_says() {
        let (hz, stiffness) = (1.5, 1500.0);
        let (rigid, change) = change(hz, Gear { stiffness, damping: 0.4, gap: 0.0 });
        let ratio = (std::f64::consts::TAU * hz).powi(2) * 2.0 / stiffness;
        let gain = ratio / (1.0 - ratio);
        let late = 4000..5800;
        let (product, square) = late.fold((0.0, 0.0), |(p, s), k| (p + rigid[k] * change[k], s + rigid[k] * rigid[k]));
        // Damping turns a little of it by 90 degrees and takes a little away.
        assert!((product / square - gain).abs() < 0.12 * gain, "{} {gain}", product / square);
    }

    #[test]
    fn a_stiff_gear_without_play_changes_nothing() {
        let (rigid, change) = change(1.0, Gear { stiffness: 1e6, damping: 0.5, gap: 0.0 });
        let size = |x: &[f64]| x[3000..5800].iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!(size(&change) < 2e-3 * size(&rigid), "{} {}", size(&change), size(&rigid));
    }

    /// In the middle of the play nothing pushes the link, so the motor carries nothing.
    #[test]
    fn a_gear_with_play_lets_go() {
        let (rigid, change) = change(1.0, Gear { stiffness: 2e4, damping: 0.3, gap: 0.05 });
        let free = (3000..5800).filter(|k| (rigid[*k] + change[*k]).abs() < 1e-9).count();
        assert!(free > 100, "{free} samples without contact");
    }
}
