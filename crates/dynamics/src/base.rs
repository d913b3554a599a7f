//! Base parameters: the smallest set of columns that spans what the joint torques can tell.
//!
//! Numerically (Gautier 1990): a tall regressor over random states is factored column by column; a column that the
//! kept ones span is dropped and its parameter folded into theirs. The order of the visit is fixed (but that columns of which
//! little is left wait to the end), so that one model has one base: drives first (`rotor_inertia`, `viscous`, `coulomb`, `offset`, `load_friction`,
//! `viscous_quadratic`, `coupling`), then links tip to base.
//! A drive parameter so stays itself where that is possible, and link parameters fold into it or into links nearer
//! the tip.

use crate::arm::JointKind;
use crate::model::Model;
use crate::parameters::Parameter;
use crate::rigid::Workspace;

/// A column is spanned by the kept ones if less than this is left of it, in parts of the largest column of its kind.
/// Exact dependence leaves 1e-14 and a right angle written as 1.5708 up to 4e-6; independent columns keep 1e-2 and
/// more on the reference arms, 5e-5 on the worst of 2000 random ones.
const TOLERANCE: f64 = 1e-5;
/// A column that keeps less than this waits until all others have been visited. Two axes that pass each other at a
/// fraction of a millimetre make a difference of two masses that can be told, barely: kept at its turn it would stand for inertias
/// nearer the base, with factors of 1e7; these are kept instead, and it folds into them.
const FAINT: f64 = 5e-3;
/// A kind without any column larger than this part of the largest of all is measured by that part instead: otherwise
/// the rounding errors of columns that are all zero would be measured by themselves.
const SMALLEST_KIND: f64 = 1e-3;
/// Ratio between the last kept and the first dropped residual from which on the geometry says clearly which columns depend on others. Axes
/// that are parallel but for a calibration (1e-3 to 1e-5 rad) make columns at every size between: see [`BaseSet::new`].
const CLEAR_GAP: f64 = 1e4;
/// Random states that the decision rests on.
const STATES: usize = 200;
/// Regrouping factors below this, with both columns in parts of their kind's largest, are rounding.
const ZERO_FACTOR: f64 = 1e-12;

/// How clearly the kept columns differ from the dropped ones: what the columns before it leave of a column, in parts
/// of the largest column of its kind (masses, first moments, inertias, viscous friction, ...).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RankGap {
    /// Smallest residual of a kept column.
    pub smallest_kept: f64,
    /// Largest residual of a dropped column; 0 when none was dropped.
    pub largest_dropped: f64,
}

impl RankGap {
    /// Kept over dropped; infinite when nothing was left of any dropped column.
    pub fn ratio(&self) -> f64 {
        self.smallest_kept / self.largest_dropped
    }
}

/// Why no base set could be found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BaseError {
    /// The regressor has a NaN or an infinity.
    #[error("the regressor is not finite: geometry or gravity of the arm is not")]
    NotFinite,
}

/// A base parameter set: K independent columns of the standard regressor, and what each stands for.
///
/// `Y·x = Y_b·x_b` for every motion, with `Y_b` the kept columns and `x_b = x_kept + Σ factor·x_dropped`.
#[derive(Clone, Debug, PartialEq)]
pub struct BaseSet {
    /// Standard index of each kept column, in base order.
    pub independent: Vec<usize>,
    /// How clear the choice was.
    pub gap: RankGap,
    /// What the columns before it leave of each kept column, in parts of the largest of its kind: the inverse of its condition.
    pub residuals: Vec<f64>,
    /// For each base parameter: dropped columns that fold into it, and their factors.
    regrouping: Vec<Vec<(usize, f64)>>,
}

impl BaseSet {
    /// Finds the base of `model` from seeded random states within the joint limits.
    ///
    /// Where the geometry does not say clearly which columns depend on others ([`is_clear`](BaseSet::is_clear)), those that are hardly
    /// separated are kept, the best separated first, so that what folds into them has small factors. Their torque is lost nowhere; what is
    /// dropped is at most 1e-5 of the largest column of its kind. Data hardly tell them: the prior holds them.
    ///
    /// # Errors
    /// When the regressor is not finite.
    pub fn new(model: &Model) -> Result<BaseSet, BaseError> {
        let columns = sample(model, STATES, 0x5eed);
        let scales = scales(model, &columns);
        if scales.iter().any(|scale| !scale.is_finite()) {
            return Err(BaseError::NotFinite);
        }
        let order = visiting_order(model);
        let found = Factors::new(&columns, &scales).visit(&order, Waiting::InOrder);
        if found.is_clear() {
            return Ok(found);
        }
        Ok(Factors::new(&columns, &scales).visit(&order, Waiting::LargestFirst))
    }

    /// Whether the geometry says clearly which columns depend on others.
    pub fn is_clear(&self) -> bool {
        self.gap.ratio() >= CLEAR_GAP
    }

    /// Base parameters that the geometry hardly separates from those before them.
    pub fn hardly_separated(&self) -> impl Iterator<Item = usize> {
        (0..self.len()).filter(|&i| self.residuals[i] <= FAINT)
    }

    /// Number of base parameters.
    #[expect(clippy::len_without_is_empty, reason = "a base always has parameters")]
    pub fn len(&self) -> usize {
        self.independent.len()
    }

    /// Base vector that makes the same torques as the standard vector `x`.
    #[must_use]
    pub fn from_standard(&self, x: &[f64]) -> Vec<f64> {
        let fold = |(&c, folded): (&usize, &Vec<(usize, f64)>)| {
            x[c] + folded.iter().map(|&(d, factor)| factor * x[d]).sum::<f64>()
        };
        self.independent.iter().zip(&self.regrouping).map(fold).collect()
    }

    /// Standard deviations of the base parameters where the entries of the standard vector have the independent ones of `std`. What `std`
    /// is too short for has none.
    #[must_use]
    pub fn std_from_standard(&self, std: &[f64]) -> Vec<f64> {
        let square = |c: usize| std.get(c).map_or(0.0, |std| std * std);
        let fold = |(&c, folded): (&usize, &Vec<(usize, f64)>)| {
            (square(c) + folded.iter().map(|&(d, factor)| factor * factor * square(d)).sum::<f64>()).sqrt()
        };
        self.independent.iter().zip(&self.regrouping).map(fold).collect()
    }

    /// Name of base parameter `i`: that of its kept column, with a `+` when others fold into it (`l6.mcx`, `l4.Izz+`).
    pub fn name(&self, model: &Model, i: usize) -> String {
        let kept = model.parameters[self.independent[i]].name(&model.arm);
        if self.regrouping[i].is_empty() { kept } else { kept + "+" }
    }

    /// The meaning of the kept column of base parameter `i`.
    pub fn parameter(&self, model: &Model, i: usize) -> Parameter {
        model.parameters[self.independent[i]]
    }

    /// Standard indices of the dropped columns that fold into base parameter `i`, with their factors.
    pub fn regrouping(&self, i: usize) -> Vec<(usize, f64)> {
        self.regrouping[i].clone()
    }

    /// Picks the base columns out of a standard regressor: `y_full` has rows of `n_full` columns, `y_base` gets as many
    /// rows of [`len`](BaseSet::len) columns. Real-time safe.
    pub fn select(&self, y_full: &[f64], n_full: usize, y_base: &mut [f64]) {
        for (full, base) in y_full.chunks_exact(n_full).zip(y_base.chunks_exact_mut(self.len())) {
            for (out, &c) in base.iter_mut().zip(&self.independent) {
                *out = full[c];
            }
        }
    }
}

/// In which order columns of which little is left are visited in the end.
#[derive(Clone, Copy, PartialEq)]
enum Waiting {
    InOrder,
    LargestFirst,
}

/// The factorisation of the columns, one by one.
struct Factors<'a> {
    columns: &'a [Vec<f64>],
    scales: &'a [f64],
    /// Orthonormal directions of the kept columns.
    directions: Vec<Vec<f64>>,
    /// R: entry k has the projections of the k-th kept column on the directions before it, then its own residual.
    projections: Vec<Vec<f64>>,
    found: BaseSet,
}

impl<'a> Factors<'a> {
    fn new(columns: &'a [Vec<f64>], scales: &'a [f64]) -> Factors<'a> {
        let found = BaseSet {
            independent: Vec::new(),
            gap: RankGap { smallest_kept: f64::INFINITY, largest_dropped: 0.0 },
            residuals: Vec::new(),
            regrouping: Vec::new(),
        };
        Factors { columns, scales, directions: Vec::new(), projections: Vec::new(), found }
    }

    fn visit(mut self, order: &[usize], waiting: Waiting) -> BaseSet {
        let mut faint: Vec<usize> = order.iter().copied().filter(|&c| !self.take(c, FAINT)).collect();
        if waiting == Waiting::InOrder {
            for c in faint {
                self.take(c, TOLERANCE);
            }
            return self.found;
        }
        let mut left: Vec<Vec<f64>> = faint.iter().map(|&c| self.columns[c].clone()).collect();
        let mut known = 0;
        while !faint.is_empty() {
            for column in &mut left {
                orthogonalise(column, &self.directions[known..]);
            }
            known = self.directions.len();
            let residual = |k: usize| norm(&left[k]) / self.scales[faint[k]];
            // The first of equals, so that one model has one base.
            let most = (1..faint.len()).fold(0, |most, k| if residual(k) > residual(most) { k } else { most });
            left.remove(most);
            self.take(faint.remove(most), TOLERANCE);
        }
        self.found
    }

    /// Keeps a column of which more than `least` is left, or folds one into those kept that they span. False for one between the two.
    fn take(&mut self, c: usize, least: f64) -> bool {
        let mut column = self.columns[c].clone();
        let mut along = orthogonalise(&mut column, &self.directions);
        let left = norm(&column);
        let residual = left / self.scales[c];
        if residual > least {
            self.found.gap.smallest_kept = self.found.gap.smallest_kept.min(residual);
            for x in &mut column {
                *x /= left;
            }
            self.directions.push(column);
            along.push(left);
            self.projections.push(along);
            self.found.independent.push(c);
            self.found.residuals.push(residual);
            self.found.regrouping.push(Vec::new());
        } else if residual <= TOLERANCE {
            self.found.gap.largest_dropped = self.found.gap.largest_dropped.max(residual);
            back_substitute(&self.projections, &mut along);
            for (k, &factor) in along.iter().enumerate() {
                if factor.abs() * self.scales[self.found.independent[k]] > ZERO_FACTOR * self.scales[c] {
                    self.found.regrouping[k].push((c, factor));
                }
            }
        } else {
            return false;
        }
        true
    }
}

/// Standard indices in the order in which columns are tried.
fn visiting_order(model: &Model) -> Vec<usize> {
    let mut order: Vec<usize> = (0..model.len()).collect();
    // Stable: within a drive group joints stay base to tip, within a link entries stay in their order.
    order.sort_by_key(|&c| match model.parameters[c] {
        Parameter::RotorInertia(_) => 0,
        Parameter::Viscous(_) => 1,
        Parameter::Coulomb(_) => 2,
        Parameter::Offset(_) => 3,
        Parameter::LoadFriction(_) => 4,
        Parameter::ViscousQuadratic(_) => 5,
        Parameter::CouplingInertia | Parameter::CouplingViscous | Parameter::CouplingCoulomb => 6,
        Parameter::Link { link, .. } => 7 + model.arm.dof() - link,
    });
    order
}

/// For each column the norm of the largest of its kind: what a residual is measured by. Columns of one kind share a
/// unit, so a millimetre of offset between two axes does not count as much as a metre.
fn scales(model: &Model, columns: &[Vec<f64>]) -> Vec<f64> {
    let kind = |c: usize| match model.parameters[c] {
        Parameter::Link { entry: 0, .. } => 0,
        Parameter::Link { entry: 1..=3, .. } => 1,
        Parameter::Link { .. } => 2,
        Parameter::RotorInertia(_) => 3,
        Parameter::Viscous(_) => 4,
        Parameter::Coulomb(_) => 5,
        Parameter::Offset(_) => 6,
        Parameter::CouplingInertia => 7,
        Parameter::CouplingViscous => 8,
        Parameter::CouplingCoulomb => 9,
        Parameter::LoadFriction(_) => 10,
        Parameter::ViscousQuadratic(_) => 11,
    };
    // Not f64::max, which would lose a NaN.
    let larger = |a: f64, b: f64| if a >= b { a } else { b };
    let norms: Vec<f64> = columns.iter().map(|column| norm(column)).collect();
    let floor = SMALLEST_KIND * norms.iter().copied().fold(0.0, larger);
    let mut largest = [floor; 12];
    for (c, &norm) in norms.iter().enumerate() {
        largest[kind(c)] = larger(largest[kind(c)], norm);
    }
    (0..norms.len()).map(|c| largest[kind(c)]).collect()
}

/// Columns of the regressor stacked over random states. Positions fill the limits (±π rad or ±1 m where there are
/// none), speeds the speed limit (1 to 3 rad/s where there is none), accelerations ±10 rad/s². Friction takes the
/// hard sign: a soft one differs only near standstill, and which columns depend on each other is the same.
fn sample(model: &Model, states: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut hard = model.clone();
    hard.structure.sign_velocity = 0.0;
    let (dof, width) = (model.arm.dof(), model.len());
    let mut ws = Workspace::new(&model.arm);
    let mut random = SplitMix(seed);
    let mut y = vec![0.0; dof * width];
    let mut columns = vec![Vec::with_capacity(states * dof); width];
    let (mut q, mut qd, mut qdd) = (vec![0.0; dof], vec![0.0; dof], vec![0.0; dof]);
    for _ in 0..states {
        for (j, joint) in model.arm.joints.iter().enumerate() {
            let reach = if joint.kind == JointKind::Revolute { std::f64::consts::PI } else { 1.0 };
            q[j] = random.between(joint.lower.clamp(-reach, reach), joint.upper.clamp(-reach, reach));
            let fastest = if joint.velocity.is_finite() { joint.velocity } else { random.between(1.0, 3.0) };
            qd[j] = random.between(-fastest, fastest);
            qdd[j] = random.between(-10.0, 10.0);
        }
        hard.regressor(&mut ws, &q, &qd, &qdd, &mut y);
        for row in y.chunks_exact(width) {
            for (column, &entry) in columns.iter_mut().zip(row) {
                column.push(entry);
            }
        }
    }
    columns
}

/// SplitMix64 (Steele, Lea & Flood 2014): the same states on every machine.
struct SplitMix(u64);

impl SplitMix {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let unit = ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64;
        low + (high - low) * unit
    }
}

fn norm(a: &[f64]) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Takes the part along `directions` out of `column` and returns it. Modified Gram-Schmidt run twice, which leaves
/// the rest orthogonal to rounding (Giraud, Langou & Rozložník 2005).
fn orthogonalise(column: &mut [f64], directions: &[Vec<f64>]) -> Vec<f64> {
    let mut along = vec![0.0; directions.len()];
    for _ in 0..2 {
        for (sum, direction) in along.iter_mut().zip(directions) {
            let part: f64 = column.iter().zip(direction).map(|(a, b)| a * b).sum();
            column.iter_mut().zip(direction).for_each(|(a, b)| *a -= part * b);
            *sum += part;
        }
    }
    along
}

/// Solves `R·k = along` in place; column k of R is `projections[k]` (k entries above the diagonal, then the diagonal).
fn back_substitute(projections: &[Vec<f64>], along: &mut [f64]) {
    for k in (0..along.len()).rev() {
        let column = &projections[k];
        let factor = along[k] / column[k];
        along[k] = factor;
        for (above, r) in along[..k].iter_mut().zip(column) {
            *above -= factor * r;
        }
    }
}
