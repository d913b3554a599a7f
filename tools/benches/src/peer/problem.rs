//! The problem file: everything the C++ side needs to do the same work, as text.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use rivet_benches::Workload;
use rivet_dynamics::Workspace;
use rivet_estimation::Scales;
use rivet_estimation::differentiate::Weights;
use rivet_estimation::filter::Butterworth;

/// Eigenvalues above this count as identified on the other side: the order of what rivet decides by.
const THRESHOLD: f64 = 4.0;

/// Writes the problem for `peer.cpp`, which has the format.
pub(crate) fn write(workload: &Workload, path: &Path) -> Result<()> {
    let mut out = model(workload);
    // Writing to a String cannot fail.
    let _ = writeln!(out, "{} ", workload.len);
    for value in samples(workload) {
        let _ = write!(out, "{value} ");
    }
    std::fs::write(path, out).with_context(|| path.display().to_string())
}

/// The same without samples, and the samples as 64 bit floats of the machine, one after the other: what `offline.py` reads.
pub(crate) fn write_apart(workload: &Workload, path: &Path, samples_path: &Path) -> Result<()> {
    std::fs::write(path, model(workload)).with_context(|| path.display().to_string())?;
    let bytes: Vec<u8> = samples(workload).flat_map(f64::to_ne_bytes).collect();
    std::fs::write(samples_path, bytes).with_context(|| samples_path.display().to_string())
}

/// Positions, torques and planned motion of one sample after the other.
fn samples(workload: &Workload) -> impl Iterator<Item = f64> + '_ {
    let samples = &workload.samples;
    (0..workload.len).flat_map(move |k| {
        let planned = workload.planned(k);
        let parts = [workload.row(&samples.q, k), workload.row(&samples.tau, k), planned.q, planned.qd, planned.qdd];
        parts.into_iter().flatten().copied()
    })
}

/// All but the samples.
fn model(workload: &Workload) -> String {
    let Workload { robot, .. } = workload;
    let (model, settings) = (&robot.model, workload.settings(1));
    let mut out = String::new();
    let mut put = |values: &[f64]| {
        for v in values {
            // Writing to a String cannot fail.
            let _ = write!(out, "{v} ");
        }
        out.push('\n');
    };
    let n = robot.dof();
    let joint = |j: Option<usize>| j.map_or(-1.0, |j| j as f64);
    let coupling = model.structure.coupling;
    put(&[n as f64, settings.sample_period_s, settings.forgetting(), model.structure.sign_velocity, THRESHOLD]);
    put(&[
        joint(coupling.map(|c| c.driving)),
        joint(coupling.map(|c| c.driven)),
        f64::from(u8::from(model.structure.offset)),
    ]);
    put(&model.arm.gravity);
    for (joint, body) in model.arm.joints.iter().zip(&model.arm.links) {
        put(&joint.rotation.concat());
        put(&joint.translation);
        put(&joint.axis);
        put(body);
    }
    put(&[robot.base.len() as f64]);
    put(&robot.base.independent.iter().map(|c| *c as f64).collect::<Vec<_>>());
    let filter = Butterworth::low_pass(settings.filter_order, settings.filter_hz, 1.0 / settings.sample_period_s);
    put(&[filter.sections.len() as f64]);
    filter.sections.iter().for_each(|section| put(section));
    let weights = Weights::new(settings.differentiator, settings.sample_period_s);
    put(&[weights.position.len() as f64]);
    for ((p, v), a) in weights.position.iter().zip(&weights.velocity).zip(&weights.acceleration) {
        put(&[*p, *v, *a]);
    }
    let scales = Scales::of_model(model, &robot.base, &robot.nominal_base, settings.torque_noise.as_deref());
    put(&scales.column);
    put(&scales.torque_noise);
    out
}

/// Figures that both sides must agree on, under the names that the peer prints.
pub(crate) fn checks(workload: &Workload) -> Vec<(String, f64)> {
    let robot = &workload.robot;
    let (n, width, k) = (robot.dof(), robot.model.len(), robot.base.len());
    let mut ws = Workspace::new(&robot.model.arm);
    let (mut y, mut d) = (vec![0.0; n * width], vec![0.0; n * k]);
    let planned = workload.planned(7);
    robot.model.regressor(&mut ws, planned.q, planned.qd, planned.qdd, &mut y);
    robot.base.select(&y, width, &mut d);
    vec![("check regressor".to_owned(), d.iter().map(|d| d.abs()).sum())]
}
