//! Parts of columns: one joint's signal, values between samples, and torque of rigid bodies.

use rivet_dynamics::{Places, Workspace, inverse_dynamics};

use crate::effects::physics::{Physics, bodies, displaced};

/// A column at the rate of the log: signals by joint.
pub(crate) type Full = Vec<Option<Vec<f64>>>;

/// A column that is a signal of one joint.
pub(super) fn on(p: &Physics<'_>, joint: usize, signal: impl Fn(usize) -> f64) -> Full {
    let mut full: Full = vec![None; p.joints()];
    full[joint] = Some((0..p.samples()).map(signal).collect());
    full
}

/// Value between samples, linear; the ends hold.
pub(super) fn between(x: &[f64], place: f64) -> f64 {
    let place = place.clamp(0.0, (x.len() - 1) as f64);
    let k = (place as usize).min(x.len().saturating_sub(2));
    let share = place - k as f64;
    x[k] * (1.0 - share) + x[(k + 1).min(x.len() - 1)] * share
}

/// The joint's angle is off by δ = cos(cq) and sin(cq): rigid torques change by M δ̈ + ∂τ/∂q δ. Where the encoder itself is
/// off (`whole`) so do the drive's inertia and viscous friction. Where it is the gear, its ratio varies: by virtual work the
/// drive carries (1 + dδ/dq) of the link's torque.
pub(super) fn wave(p: &Physics<'_>, joint: usize, order: f64, whole: bool) -> Vec<Full> {
    let (q, qd, qdd) = (&p.motion.q[joint], &p.motion.qd[joint], &p.motion.qdd[joint]);
    let n = p.joints();
    let (rotor, viscous) = (p.x[Places::new(n).rotor_inertia(joint)], p.x[Places::new(n).viscous(joint)]);
    let made = |cosine: bool| {
        let mut delta = Vec::with_capacity(q.len());
        let mut accel = Vec::with_capacity(q.len());
        let mut drive = Vec::with_capacity(q.len());
        for k in 0..q.len() {
            let (sin, cos) = (order * q[k]).sin_cos();
            let (d, slope) = if cosine { (cos, -sin) } else { (sin, cos) };
            let a = order * slope * qdd[k] - order * order * d * qd[k] * qd[k];
            delta.push(d);
            accel.push(a);
            drive.push(if whole {
                rotor * a + viscous * order * slope * qd[k]
            } else {
                order * slope * p.rigid[joint][k]
            });
        }
        let mut full = displaced(p, joint, &delta, &accel);
        if let Some(own) = &mut full[joint] {
            own.iter_mut().zip(&drive).for_each(|(t, d)| *t += d);
        }
        full
    };
    vec![made(true), made(false)]
}

/// The same where the joint's angle is another multiple of what is measured; and with its zero elsewhere.
pub(super) fn scale(p: &Physics<'_>, joint: usize) -> Vec<Full> {
    let (q, qd, qdd) = (&p.motion.q[joint], &p.motion.qd[joint], &p.motion.qdd[joint]);
    let n = p.joints();
    let (rotor, viscous) = (p.x[Places::new(n).rotor_inertia(joint)], p.x[Places::new(n).viscous(joint)]);
    let mut scale = displaced(p, joint, q, qdd);
    if let Some(own) = &mut scale[joint] {
        own.iter_mut().zip(qdd).zip(qd).for_each(|((t, a), v)| *t += rotor * a + viscous * v);
    }
    vec![scale, displaced(p, joint, &vec![1.0; q.len()], &vec![0.0; q.len()])]
}

/// Rigid torque of one body alone, links before it massless.
pub(super) fn body(p: &Physics<'_>, link: usize, parameters: &[f64; 10]) -> Full {
    let n = p.joints();
    let mut links = vec![[0.0; 10]; n];
    links[link] = *parameters;
    rigid(p, &links, p.nominal.model.arm.gravity, None)
}

/// Torque of bodies along the motion, or at its positions with the rates of one that stands `still`.
fn rigid(p: &Physics<'_>, links: &[[f64; 10]], gravity: [f64; 3], still: Option<&[f64]>) -> Full {
    let n = p.joints();
    let mut arm = p.nominal.model.arm.clone();
    arm.gravity = gravity;
    let mut ws = Workspace::new(&arm);
    let (mut q, mut qd, mut qdd, mut tau) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut full: Full = vec![Some(Vec::with_capacity(p.samples())); n];
    for k in 0..p.samples() {
        p.motion.state(k, &mut q, &mut qd, &mut qdd);
        let (qd, qdd) = still.map_or((&qd[..], &qdd[..]), |s| (s, s));
        inverse_dynamics(&arm, links, &mut ws, &q, qd, qdd, &mut tau);
        full.iter_mut().zip(&tau).for_each(|(signal, tau)| {
            if let Some(signal) = signal {
                signal.push(*tau);
            }
        });
    }
    full
}

/// The base's axes.
pub(crate) const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Torque per m/s² of gravity along the base's x and y: that of the arm at rest, since gravity enters linearly.
pub(super) fn gravity(p: &Physics<'_>) -> Vec<Full> {
    let links = bodies(&p.x, p.joints());
    let still = vec![0.0; p.joints()];
    AXES[..2].iter().map(|g| rigid(p, &links, *g, Some(&still))).collect()
}
