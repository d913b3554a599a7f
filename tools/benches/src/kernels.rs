//! The kernels: what is measured, each as a call that does it once more.

use std::hint::black_box;
use std::sync::Arc;

use anyhow::{Context, Result};
use rivet_dynamics::{Workspace, inverse_dynamics, regressor};
use rivet_estimation::filter::{Bank, Butterworth};
use rivet_estimation::{
    ColumnsSettings, EigenSettings, EstimatorKind, Identifier, Settings, Supervision, TrackedSettings,
};

use crate::Workload;

/// What is measured. Periods are [`Identifier::push`] with setpoints; unless it says otherwise, every sample makes rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// Torques of one state.
    InverseDynamics,
    /// Regressor of the links, one state.
    Regressor,
    /// Model filter over what one period has to filter: regressor and instruments.
    Filter,
    /// A period that makes no rows: differentiation, both regressors, model filter.
    Front,
    /// A period with RIV, unsupervised.
    Plain,
    /// A period with plain least squares (UD).
    LeastSquares,
    /// A period with RIV, supervised by the paper's columns.
    Columns,
    /// A period with RIV, supervised by a full eigen-decomposition, a step each period.
    Eigen,
    /// A period with RIV, supervised in a basis that follows the information.
    Tracked,
    /// A period as the robot file sets it, but with rows every sample.
    Supervised,
    /// A period as the robot file sets it.
    Default,
}

impl Kernel {
    /// All of them.
    pub const ALL: [Kernel; 11] = [
        Kernel::InverseDynamics,
        Kernel::Regressor,
        Kernel::Filter,
        Kernel::Front,
        Kernel::Plain,
        Kernel::LeastSquares,
        Kernel::Columns,
        Kernel::Eigen,
        Kernel::Tracked,
        Kernel::Supervised,
        Kernel::Default,
    ];

    /// Its name in tables and benchmark ids.
    pub fn name(self) -> &'static str {
        match self {
            Kernel::InverseDynamics => "inverse-dynamics",
            Kernel::Regressor => "regressor",
            Kernel::Filter => "filter",
            Kernel::Front => "front",
            Kernel::Plain => "plain",
            Kernel::LeastSquares => "least-squares",
            Kernel::Columns => "columns",
            Kernel::Eigen => "eigen",
            Kernel::Tracked => "tracked",
            Kernel::Supervised => "supervised",
            Kernel::Default => "default",
        }
    }
}

/// A call that does `kernel` once, on one state or sample of the workload after the other.
pub fn kernel<'a>(workload: &'a Workload, kernel: Kernel) -> Result<Box<dyn FnMut() + 'a>> {
    let Workload { robot, len, .. } = workload;
    let (model, n, len) = (&robot.model, robot.dof(), *len);
    let mut next = 0;
    let mut advance = move || {
        next = if next + 1 < len { next + 1 } else { 0 };
        next
    };
    let settings = |decimation: usize| workload.settings(decimation);
    let supervision = |supervision: Supervision| Settings { supervision, ..settings(1) };
    Ok(match kernel {
        Kernel::InverseDynamics => {
            let (mut ws, mut tau) = (Workspace::new(&model.arm), vec![0.0; n]);
            Box::new(move || {
                let m = workload.planned(advance());
                inverse_dynamics(&model.arm, &model.arm.links, &mut ws, m.q, m.qd, m.qdd, black_box(&mut tau));
            })
        }
        Kernel::Regressor => {
            let (mut ws, mut y) = (Workspace::new(&model.arm), vec![0.0; n * 10 * n]);
            Box::new(move || {
                let m = workload.planned(advance());
                regressor(&model.arm, &mut ws, m.q, m.qd, m.qdd, black_box(&mut y));
            })
        }
        Kernel::Filter => {
            let settings = settings(1);
            let rate = 1.0 / settings.sample_period_s;
            let filter = Butterworth::low_pass(settings.filter_order, settings.filter_hz, rate);
            let links: usize = robot.base.independent.iter().filter(|c| **c < 10 * n).map(|c| c / 10 + 1).sum();
            let channels = links + robot.base.independent.iter().filter(|c| **c >= 10 * n).count();
            let mut bank = Bank::new(filter, 2 * channels + n);
            let mut x: Vec<f64> = (0..2 * channels + n).map(|i| i as f64).collect();
            Box::new(move || bank.step(black_box(&mut x)))
        }
        // Rows so rare that they do not count; the cut-off has to be as low as that.
        Kernel::Front => push(workload, &Settings { filter_hz: 0.5, ..settings(400) }, advance)?,
        Kernel::Plain => push(workload, &supervision(Supervision::Off), advance)?,
        Kernel::LeastSquares => {
            push(workload, &Settings { estimator: EstimatorKind::Rls, ..supervision(Supervision::Off) }, advance)?
        }
        Kernel::Columns => push(workload, &supervision(Supervision::Columns(ColumnsSettings::default())), advance)?,
        Kernel::Eigen => push(workload, &supervision(Supervision::Eigen(EigenSettings::default())), advance)?,
        Kernel::Tracked => push(workload, &supervision(Supervision::Tracked(TrackedSettings::default())), advance)?,
        Kernel::Supervised => push(workload, &settings(1), advance)?,
        Kernel::Default => push(workload, &settings(robot.config.signal.decimation), advance)?,
    })
}

/// Pushes sample after sample, once the filters have settled and directions have begun to move.
fn push<'a>(
    workload: &'a Workload,
    settings: &Settings,
    mut advance: impl FnMut() -> usize + 'a,
) -> Result<Box<dyn FnMut() + 'a>> {
    let robot = &workload.robot;
    let mut identifier =
        Identifier::new(Arc::clone(&robot.model), Arc::clone(&robot.base), &robot.nominal_base, settings)
            .context("settings of the benchmark")?;
    let mut once = move || {
        let k = advance();
        let (q, tau) = (workload.row(&workload.samples.q, k), workload.row(&workload.samples.tau, k));
        black_box(identifier.push(q, tau, Some(workload.planned(k))));
    };
    for _ in 0..workload.len {
        once();
    }
    Ok(Box::new(once))
}
