//! Physically consistent parameters near identified ones.
//!
//! Identified base parameters are linear and free: noise and unmodelled effects may leave values that no arm has, such
//! as a mass matrix that is not positive definite. [`project`] finds the standard parameters χ that can be built and
//! whose base parameters G·χ are nearest:
//!
//! ```text
//! min over χ of  (G·χ − x_b)ᵀ·C⁻¹·(G·χ − x_b) + γ·Σ_j D(P_j(χ) ‖ P_j0)
//! D(P ‖ P0) = tr(P·P0⁻¹) − log det(P·P0⁻¹) − size              Lee, Wensing & Park 2020
//! ```
//!
//! P_j are the pseudo-inertias of the links (4×4), the values of the drives (1×1: rotor inertia, viscous, Coulomb) and,
//! for a coupled wrist, the 2×2 matrices of inertia and viscous friction of the pair; P_j0 are those of the URDF and
//! the robot file. D is its own barrier: every iterate of the damped Newton method is physical. γ falls from the
//! nominal arm until the result cannot be told from x_b (discrepancy rule), or until falling further gains nothing.

mod blocks;

use nalgebra::{DMatrix, DVector};
use rivet_dynamics::{BaseSet, LINK_PARAMETERS, LinkParameters, Model, Workspace, smallest_eigenvalue};

use blocks::Blocks;

/// γ of the first and the last problem, both relative: the data term is 1 for χ = 0.
const FIRST: f64 = 1.0;
const LAST: f64 = 1e-9;
/// γ falls by this factor from one problem to the next.
const STEP: f64 = 0.2;
/// Torque cost \[%\] that is as good as none.
const NEGLIGIBLE_PERCENT: f64 = 0.05;
/// The data term must fall by this share for γ to fall further...
const WORTH_WHILE: f64 = 1e-3;
/// ... or it has gained nothing so many times.
const PATIENCE: usize = 3;
/// Newton steps for one γ.
const NEWTON_STEPS: usize = 60;
/// Without a covariance: torque cost \[%\] below which a projection counts as exact.
const EXACT_PERCENT: f64 = 0.5;
/// Torque cost \[%\] from which on a set is another arm's. Whole motions of measured arms: up to 4.3, and 4 to 10 where the robot file lacks
/// what the arm has. [`project`] then looks for one in which a cost of `TOLERATED_PERCENT` counts as much as deviations do.
pub const FAR_PERCENT: f64 = 10.0;
const TOLERATED_PERCENT: f64 = 2.0;
/// Of its deviation, what a value may move that no reference row tells.
const STAYS: f64 = 1e-4;
/// Directions of the covariance below this share of the largest are rounding.
const COVARIANCE_RANK: f64 = 1e-12;

/// Why there is no projection.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConsistencyError {
    /// A list of the wrong length.
    #[error("{what}: {found} values, expected {expected}")]
    Shape {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length it should have.
        expected: usize,
    },
    /// A NaN or an infinity.
    #[error("{what} are not finite")]
    NotFinite {
        /// Which numbers.
        what: &'static str,
    },
    /// A nominal body or drive that cannot be a start.
    #[error("nominal values of {what} are not physical: a link needs a mass above zero")]
    Nominal {
        /// Link or drive parameter.
        what: String,
    },
    /// No progress although no minimum is reached.
    #[error("no physically consistent parameters found: {0}")]
    NoProgress(&'static str),
}

/// Rows by which torque is judged, as sums.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    columns: usize,
    /// Σ d·dᵀ per joint.
    gram: Vec<DMatrix<f64>>,
    torque_square: Vec<f64>,
    count: Vec<f64>,
}

impl Reference {
    /// Without rows yet, for `joints` joints and `columns` base parameters.
    pub fn new(joints: usize, columns: usize) -> Reference {
        let gram = vec![DMatrix::zeros(columns, columns); joints];
        Reference { columns, gram, torque_square: vec![0.0; joints], count: vec![0.0; joints] }
    }

    /// Adds rows of one joint: `d` row-major, one row of base columns for each torque of `tau` \[N·m\].
    ///
    /// # Panics
    /// If `d` is not one row of the right length for each torque.
    pub fn add(&mut self, joint: usize, d: &[f64], tau: &[f64]) {
        assert_eq!(d.len(), self.columns * tau.len(), "one row a torque");
        let d = DMatrix::from_column_slice(self.columns, tau.len(), d);
        self.gram[joint] += &d * d.transpose();
        self.torque_square[joint] += tau.iter().map(|t| t * t).sum::<f64>();
        self.count[joint] += tau.len() as f64;
    }

    /// Adds rows of one joint as sums: `gram` = Σ d·dᵀ over `count` rows, and Σ τ² \[N²·m²\].
    pub(crate) fn add_sums(&mut self, joint: usize, gram: &DMatrix<f64>, torque_square: f64, count: f64) {
        self.gram[joint] += gram;
        self.torque_square[joint] += torque_square;
        self.count[joint] += count;
    }

    /// The reference workload of the arm (seeded states within its limits at moderate speed); the torques that `values`
    /// make there are what costs are measured by. Off line and on the bus thread's side: it allocates.
    pub fn workload(model: &Model, base: &BaseSet, values: &[f64]) -> Reference {
        let (dof, full, k) = (model.arm.dof(), model.len(), base.len());
        let (mut ws, mut y, mut d) = (Workspace::new(&model.arm), vec![0.0; dof * full], vec![0.0; dof * k]);
        let mut reference = Reference::new(dof, k);
        let mut rows = vec![Vec::new(); dof];
        crate::scales::workload(model, |q, qd, qdd| {
            model.regressor(&mut ws, q, qd, qdd, &mut y);
            base.select(&y, full, &mut d);
            rows.iter_mut().zip(d.chunks_exact(k)).for_each(|(rows, d): (&mut Vec<f64>, _)| rows.extend_from_slice(d));
        });
        for (joint, d) in rows.iter().enumerate() {
            let tau: Vec<f64> = d.chunks_exact(k).map(|d| d.iter().zip(values).map(|(d, x)| d * x).sum()).collect();
            reference.add(joint, d, &tau);
        }
        reference
    }

    /// The same rows with the torques of other base parameters.
    #[must_use]
    pub fn with_torque_of(mut self, values: &[f64]) -> Reference {
        self.torque_square = (0..self.gram.len()).map(|j| self.square(j, values)).collect();
        self
    }

    /// `Σ_j G_j/(n·‖τ_j‖²)`, so that `δᵀ·M·δ` is the square of the torque cost of δ as a share.
    fn metric(&self) -> DMatrix<f64> {
        let n = self.gram.len().max(1) as f64;
        let most = self.torque_square.iter().fold(f64::MIN_POSITIVE, |m, t| m.max(*t));
        let zero = DMatrix::zeros(self.columns, self.columns);
        self.gram.iter().zip(&self.torque_square).fold(zero, |sum, (g, t)| sum + g / (n * t.max(1e-9 * most)))
    }

    /// Torque that base parameters `delta` make on these rows, per joint: root mean square \[N·m\].
    pub fn rms(&self, delta: &[f64]) -> Vec<f64> {
        (0..self.gram.len()).map(|j| (self.square(j, delta) / self.count[j].max(1.0)).sqrt()).collect()
    }

    /// The same over all joints, each in parts of its own torque \[%\].
    pub fn percent(&self, delta: &[f64]) -> f64 {
        let n = self.gram.len().max(1) as f64;
        let share = |j: usize| self.square(j, delta) / self.torque_square[j].max(f64::MIN_POSITIVE);
        100.0 * ((0..self.gram.len()).map(share).sum::<f64>() / n).sqrt()
    }

    fn square(&self, joint: usize, delta: &[f64]) -> f64 {
        let delta = DVector::from_column_slice(delta);
        delta.dot(&(&self.gram[joint] * &delta)).max(0.0)
    }
}

/// Physically consistent parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Projection {
    /// Standard parameters in the order of [`Model::parameters`].
    pub standard: Vec<f64>,
    /// Their base parameters.
    pub base: Vec<f64>,
    /// Torque between these and the identified parameters on the reference rows, all joints \[%\].
    pub torque_percent: f64,
    /// The same per joint \[N·m\].
    pub torque_rms: Vec<f64>,
    /// `(G·χ − x_b)ᵀ·C⁻¹·(G·χ − x_b)` over the number of base parameters: below 1 the noise alone explains it.
    pub distance: f64,
    /// Smallest eigenvalue of any link's pseudo-inertia, about the joint's origin.
    pub smallest_eigenvalue: f64,
    /// Newton steps in all.
    pub iterations: usize,
    /// γ that was chosen, relative to a data term of 1.
    pub gamma: f64,
    /// Links whose nominal body has no extent in some direction, and was given one.
    pub thickened: Vec<String>,
}

/// Projects identified base parameters onto physically consistent ones.
///
/// * `values`: x_b in the order of `base`
/// * `covariance`: C, row-major K×K, or its diagonal (K values)
/// * `nominal`: standard parameters of the arm as it is known before
/// * `reference`: rows on which the torque cost is measured
///
/// # Errors
/// See [`ConsistencyError`]; a moving link without nominal mass is one.
pub fn project(
    model: &Model,
    base: &BaseSet,
    values: &[f64],
    covariance: &[f64],
    nominal: &[f64],
    reference: &Reference,
) -> Result<Projection, ConsistencyError> {
    check(model, base, values, nominal, reference)?;
    if covariance.iter().any(|x| !x.is_finite()) {
        return Err(ConsistencyError::NotFinite { what: "covariances" });
    }
    let mut covariance = square(covariance, base.len())?;
    // What no reference row tells stays where it is: its deviation, a prior's, would leave it to whatever else the projection likes.
    for i in (0..base.len()).filter(|i| reference.gram.iter().all(|gram| gram[(*i, *i)] == 0.0)) {
        covariance.row_mut(i).scale_mut(STAYS);
        covariance.column_mut(i).scale_mut(STAYS);
    }
    let information = information(&covariance)?;
    let near = nearest(model, base, values, &information, nominal, reference)?;
    if near.torque_percent <= FAR_PERCENT {
        return Ok(near);
    }
    // Deviations that say nothing (few rows, weak instruments) leave the set anywhere: then torque counts beside them.
    let regularised = information + as_torque(base, reference, TOLERATED_PERCENT);
    let nearer = nearest(model, base, values, &regularised, nominal, reference).ok();
    Ok(nearer.filter(|nearer| nearer.torque_percent < near.torque_percent).unwrap_or(near))
}

/// As [`project`], nearest in torque: the distance of two sets is the torque between them on the reference rows, each
/// joint's in parts of its own, and half a percent of torque counts as none. For sets whose covariance is not at hand.
///
/// # Errors
/// See [`ConsistencyError`].
pub fn project_torque(
    model: &Model,
    base: &BaseSet,
    values: &[f64],
    nominal: &[f64],
    reference: &Reference,
) -> Result<Projection, ConsistencyError> {
    check(model, base, values, nominal, reference)?;
    nearest(model, base, values, &as_torque(base, reference, EXACT_PERCENT), nominal, reference)
}

/// The information under which a torque cost of `percent` \[%\] is a distance of 1.
fn as_torque(base: &BaseSet, reference: &Reference, percent: f64) -> DMatrix<f64> {
    reference.metric() * (base.len() as f64 * (100.0 / percent).powi(2))
}

fn check(
    model: &Model,
    base: &BaseSet,
    values: &[f64],
    nominal: &[f64],
    reference: &Reference,
) -> Result<(), ConsistencyError> {
    let (k, full) = (base.len(), model.len());
    let shape = |what, found, expected| Err(ConsistencyError::Shape { what, found, expected });
    if values.len() != k {
        return shape("base parameters", values.len(), k);
    }
    if nominal.len() != full {
        return shape("nominal parameters", nominal.len(), full);
    }
    if reference.columns != k || reference.gram.len() != model.arm.dof() {
        return shape("columns of the reference rows", reference.columns, k);
    }
    if values.iter().any(|x| !x.is_finite()) {
        return Err(ConsistencyError::NotFinite { what: "base parameters" });
    }
    Ok(())
}

fn nearest(
    model: &Model,
    base: &BaseSet,
    values: &[f64],
    information: &DMatrix<f64>,
    nominal: &[f64],
    reference: &Reference,
) -> Result<Projection, ConsistencyError> {
    let k = base.len();
    let problem = Problem::new(model, base, values, information, nominal)?;
    let mut chi = problem.blocks.start.clone();
    let (mut gamma, mut iterations, mut idle) = (FIRST, 0, 0);
    let mut last = f64::INFINITY;
    loop {
        iterations += problem.minimise(&mut chi, gamma)?;
        let data = problem.data(&chi);
        let difference: Vec<f64> = base.from_standard(chi.as_slice()).iter().zip(values).map(|(a, b)| a - b).collect();
        let distance = data * problem.whole / k as f64;
        let percent = reference.percent(&difference);
        idle = if data < (1.0 - WORTH_WHILE) * last { 0 } else { idle + 1 };
        last = data;
        if distance <= 1.0 || percent <= NEGLIGIBLE_PERCENT || idle >= PATIENCE || gamma * STEP < LAST {
            let link = |j: usize| {
                let mut body: LinkParameters = [0.0; LINK_PARAMETERS];
                body.copy_from_slice(&chi.as_slice()[j * LINK_PARAMETERS..(j + 1) * LINK_PARAMETERS]);
                smallest_eigenvalue(&body)
            };
            return Ok(Projection {
                base: base.from_standard(chi.as_slice()),
                standard: chi.as_slice().to_vec(),
                torque_percent: percent,
                torque_rms: reference.rms(&difference),
                distance,
                smallest_eigenvalue: (0..model.arm.dof()).map(link).fold(f64::INFINITY, f64::min),
                iterations,
                gamma,
                thickened: problem.blocks.thickened,
            });
        }
        gamma *= STEP;
    }
}

/// C of its entries, row-major, or of its diagonal.
fn square(covariance: &[f64], k: usize) -> Result<DMatrix<f64>, ConsistencyError> {
    match covariance.len() {
        found if found == k * k => Ok(DMatrix::from_row_slice(k, k, covariance)),
        found if found == k => Ok(DMatrix::from_diagonal(&DVector::from_column_slice(covariance))),
        found => Err(ConsistencyError::Shape { what: "covariances", found, expected: k * k }),
    }
}

/// C⁻¹, in directions that are not rounding.
fn information(full: &DMatrix<f64>) -> Result<DMatrix<f64>, ConsistencyError> {
    let k = full.nrows();
    if full.diagonal().min() <= 0.0 {
        return Err(ConsistencyError::NoProgress("a variance is not positive"));
    }
    let std = full.diagonal().map(f64::sqrt);
    let eigen =
        DMatrix::from_fn(k, k, |i, j| 0.5 * (full[(i, j)] + full[(j, i)]) / (std[i] * std[j])).symmetric_eigen();
    let least = COVARIANCE_RANK * eigen.eigenvalues.max();
    let inverse = DMatrix::from_diagonal(&eigen.eigenvalues.map(|v| 1.0 / v.max(least)));
    let correlation = &eigen.eigenvectors * inverse * eigen.eigenvectors.transpose();
    Ok(DMatrix::from_fn(k, k, |i, j| correlation[(i, j)] / (std[i] * std[j])))
}

struct Problem {
    blocks: Blocks,
    /// Gᵀ·C⁻¹·G and Gᵀ·C⁻¹·x_b over `whole`.
    curvature: DMatrix<f64>,
    pull: DVector<f64>,
    /// x_bᵀ·C⁻¹·x_b: what the data term is measured by.
    whole: f64,
    /// G, C⁻¹ and x_b, for a data term that does not cancel.
    g: DMatrix<f64>,
    information: DMatrix<f64>,
    target: DVector<f64>,
}

impl Problem {
    fn new(
        model: &Model,
        base: &BaseSet,
        values: &[f64],
        information: &DMatrix<f64>,
        nominal: &[f64],
    ) -> Result<Problem, ConsistencyError> {
        let mut g = DMatrix::zeros(base.len(), model.len());
        for (i, &own) in base.independent.iter().enumerate() {
            g[(i, own)] = 1.0;
            for (other, factor) in base.regrouping(i) {
                g[(i, other)] = factor;
            }
        }
        let target = DVector::from_column_slice(values);
        let whole = target.dot(&(information * &target));
        if whole <= 0.0 || !whole.is_finite() {
            return Err(ConsistencyError::NoProgress("all identified values are zero"));
        }
        let information = information / whole;
        let weighted = &information * &g;
        let curvature = g.transpose() * &weighted;
        let pull = weighted.transpose() * &target;
        let blocks = Blocks::new(model, nominal, curvature.diagonal().as_slice())?;
        Ok(Problem { blocks, curvature, pull, whole, g, information, target })
    }

    /// The data term.
    fn data(&self, chi: &DVector<f64>) -> f64 {
        let off = &self.g * chi - &self.target;
        off.dot(&(&self.information * &off))
    }

    /// The objective; none where χ is not physical.
    fn value(&self, chi: &DVector<f64>, gamma: f64) -> Option<f64> {
        let divergence: Option<f64> = self.blocks.all.iter().map(|b| b.divergence(chi)).sum();
        Some(self.data(chi) + gamma * divergence?)
    }

    /// Gradient and Hessian at a physical χ. With P the block: ∂D/∂χᵢ = tr Eᵢ − tr(P⁻¹Eᵢ),
    /// ∂²D/∂χᵢ∂χₖ = tr(P⁻¹·Eᵢ·P⁻¹·Eₖ).
    fn derivatives(&self, chi: &DVector<f64>, gamma: f64) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let mut gradient = (&self.curvature * chi - &self.pull) * 2.0;
        let mut hessian = &self.curvature * 2.0;
        for block in &self.blocks.all {
            let inverse = block.value(chi).cholesky()?.inverse();
            let turned: Vec<DMatrix<f64>> = block.entries.iter().map(|(_, e)| &inverse * e).collect();
            for (a, (i, e)) in block.entries.iter().enumerate() {
                gradient[*i] += gamma * (e.trace() - turned[a].trace());
                for (b, (k, _)) in block.entries.iter().enumerate() {
                    hessian[(*i, *k)] += gamma * turned[a].component_mul(&turned[b].transpose()).sum();
                }
            }
        }
        Some((gradient, hessian))
    }

    /// Damped Newton from a physical χ; returns the number of steps.
    fn minimise(&self, chi: &mut DVector<f64>, gamma: f64) -> Result<usize, ConsistencyError> {
        let lost = ConsistencyError::NoProgress("an iterate is not physical");
        let mut value = self.value(chi, gamma).ok_or_else(|| lost.clone())?;
        for step in 0..NEWTON_STEPS {
            let (gradient, hessian) = self.derivatives(chi, gamma).ok_or_else(|| lost.clone())?;
            let direction = newton_direction(&gradient, hessian).ok_or(ConsistencyError::NoProgress("flat"))?;
            let slope = gradient.dot(&direction);
            // Half the Newton decrement is what a step can still gain.
            if -slope <= 1e-9 * gamma.min(1e-3 * value.max(f64::MIN_POSITIVE)) {
                return Ok(step);
            }
            let mut length = 1.0;
            loop {
                let next = &*chi + &direction * length;
                match self.value(&next, gamma) {
                    Some(v) if v <= value + 0.1 * length * slope => {
                        (*chi, value) = (next, v);
                        break;
                    }
                    _ => length *= 0.5,
                }
                // Rounding hides what is left to gain: the iterate is physical and as good as it gets.
                if length < 1e-9 {
                    return Ok(step);
                }
            }
        }
        Ok(NEWTON_STEPS)
    }
}

/// `−H⁻¹·g`, rows and columns scaled to a unit diagonal first; a little is added to the diagonal until the factors exist.
fn newton_direction(gradient: &DVector<f64>, mut hessian: DMatrix<f64>) -> Option<DVector<f64>> {
    let n = gradient.len();
    let scale = hessian.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 1.0 });
    for i in 0..n {
        for k in 0..n {
            hessian[(i, k)] *= scale[i] * scale[k];
        }
    }
    let right = -gradient.component_mul(&scale);
    let mut added = 1e-15;
    while added < 1e-3 {
        for i in 0..n {
            hessian[(i, i)] += added;
        }
        if let Some(factors) = hessian.clone().cholesky() {
            let direction = factors.solve(&right).component_mul(&scale);
            return direction.iter().all(|x| x.is_finite()).then_some(direction);
        }
        added *= 10.0;
    }
    None
}

#[cfg(test)]
mod tests;
