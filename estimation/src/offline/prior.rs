//! What is known of the parameters before the records speak.
//!
//! ```text
//! x ~ N(x₀, P),   P = Σ_s σ_s²·g_s·g_sᵀ
//! ```
//!
//! The sources s are what may be wrong independently of each other, each with the direction g in which it moves the base
//! parameters: a base parameter alone, or an entry of one body, which moves all base parameters that it folds into. So a load
//! on the last link that one joint shows is expected at the joints before it as well.

use nalgebra::DMatrix;
use rivet_dynamics::{BaseSet, LINK_PARAMETERS, Model, Parameter};

use super::sums::Normal;

/// A source whose size is small or zero counts as large as that which alone makes this share of the torque of some joint.
const TORQUE_SHARE: f64 = 0.005;
/// A load at the flange that the file does not know is expected to have such a share of the mass that the first joint moves, and its
/// centre such a share of the arm's reach from the last link's origin.
const LOAD_MASS: f64 = 0.1;
const LOAD_CENTRE: f64 = 0.15;
/// Bodies may be wrong by so much of themselves; friction, which depends on wear, grease and temperature, by ten times as much.
const USUAL_BODIES: f64 = 0.7;
const USUAL_FRICTION: f64 = 7.0;
/// Values of nominal zero (offsets above all) are not known to be zero: so many times [`TORQUE_SHARE`], whatever is held of
/// the others.
const ZERO: f64 = 10.0;
/// Standard deviation of what no row sees and nothing is known of.
const UNSEEN: f64 = 1e-6;

/// One thing that may be wrong.
#[derive(Clone, Debug, PartialEq)]
struct Source {
    /// Base parameters that it moves, and by how much.
    moves: Vec<(usize, f64)>,
    /// How large it is expected to be.
    size: f64,
    /// Standard deviation in parts of that.
    relative: f64,
}

/// How far nominal values are trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trust {
    /// Bodies and drives' inertias may be wrong by so many times themselves.
    pub bodies: f64,
    /// Friction may.
    pub friction: f64,
}

impl Trust {
    /// What is usual, by so many times wider.
    pub fn usual(wide: f64) -> Trust {
        Trust { bodies: wide * USUAL_BODIES, friction: wide * USUAL_FRICTION }
    }
}

impl std::fmt::Display for Trust {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "nominal bodies x{:.2}, friction x{:.2}", self.bodies, self.friction)
    }
}

/// A normal distribution of base parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    pub(super) centre: Vec<f64>,
    sources: Vec<Source>,
}

impl Prior {
    /// Every base parameter may be wrong by itself, by `relative` of its nominal value.
    pub fn alone(nominal: &[f64], relative: f64) -> Prior {
        let source = |(i, x): (usize, &f64)| Source { moves: vec![(i, 1.0)], size: x.abs(), relative };
        Prior { centre: nominal.to_vec(), sources: nominal.iter().enumerate().map(source).collect() }
    }

    /// What `trust` says of standard parameters. Each may be wrong by itself: an entry of a body in parts of what the link's
    /// mass makes at its radius of gyration about the joint (at the last link, of what a load makes where that is more), all
    /// others in parts of their nominal value.
    ///
    /// * `nominal`: standard parameters
    pub fn new(model: &Model, base: &BaseSet, nominal: &[f64], trust: Trust) -> Prior {
        let links = model.arm.dof();
        let moved: f64 = nominal.iter().step_by(LINK_PARAMETERS).take(links).map(|m| m.max(0.0)).sum();
        let length = |t: [f64; 3]| t.iter().map(|t| t * t).sum::<f64>().sqrt();
        let reach: f64 = model.arm.joints.iter().skip(1).map(|joint| length(joint.translation)).sum();
        let load = |entry: usize| {
            let (mass, far) = (LOAD_MASS * moved, LOAD_CENTRE * reach);
            mass * match entry {
                0 => 1.0,
                1..=3 => far,
                _ => far * far,
            }
        };
        let source = |(i, parameter): (usize, &Parameter)| {
            let (size, relative) = match *parameter {
                Parameter::Link { link, entry } => {
                    let own = body_size(&nominal[link * LINK_PARAMETERS..], entry);
                    (if link + 1 == links { own.max(load(entry)) } else { own }, trust.bodies)
                }
                Parameter::RotorInertia(_) | Parameter::CouplingInertia => (nominal[i].abs(), trust.bodies),
                _ => (nominal[i].abs(), trust.friction),
            };
            Source { moves: Vec::new(), size, relative: if size > 0.0 { relative } else { relative.max(ZERO) } }
        };
        let mut sources: Vec<Source> = model.parameters.iter().enumerate().map(source).collect();
        for (i, own) in base.independent.iter().enumerate() {
            sources[*own].moves.push((i, 1.0));
            for (other, factor) in base.regrouping(i) {
                sources[other].moves.push((i, factor));
            }
        }
        sources.retain(|s| !s.moves.is_empty());
        Prior { centre: base.from_standard(nominal), sources }
    }

    /// The same, everything wrong by so many times more.
    pub(super) fn times(&self, factor: f64) -> Prior {
        let mut wider = self.clone();
        wider.sources.iter_mut().for_each(|s| s.relative *= factor);
        wider
    }

    /// The same with `more` parameters of nominal value zero.
    pub(super) fn widened(&self, more: usize, relative: f64) -> Prior {
        let mut wider = self.clone();
        for i in self.centre.len()..self.centre.len() + more {
            wider.sources.push(Source { moves: vec![(i, 1.0)], size: 0.0, relative });
            wider.centre.push(0.0);
        }
        wider
    }

    /// L with P = L·Lᵀ, lower triangular; `joints` say how much torque a source makes. None where P has no such root.
    pub(super) fn root(&self, joints: &[Normal]) -> Option<DMatrix<f64>> {
        let k = self.centre.len();
        let mut p = DMatrix::<f64>::zeros(k, k);
        for source in &self.sources {
            let square = (source.relative * source.width(joints)).powi(2);
            for (i, a) in &source.moves {
                for (j, b) in &source.moves {
                    p[(*i, *j)] += square * a * b;
                }
            }
        }
        // Units differ by orders of magnitude.
        let std = p.diagonal().map(f64::sqrt);
        let correlation = DMatrix::from_fn(k, k, |i, j| p[(i, j)] / (std[i] * std[j]));
        Some(DMatrix::from_diagonal(&std) * correlation.cholesky()?.l())
    }
}

impl Source {
    /// The size, or what alone makes [`TORQUE_SHARE`] of some joint's torque.
    fn width(&self, joints: &[Normal]) -> f64 {
        let alone = |joint: &Normal| {
            let pairs = self.moves.iter().flat_map(|(i, a)| self.moves.iter().map(move |(j, b)| (*i, *j, a * b)));
            let column: f64 = pairs.map(|(i, j, ab)| ab * joint.dd[(i, j)]).sum();
            (joint.torque_square / column.max(0.0)).sqrt()
        };
        let least = joints.iter().map(alone).filter(|v| v.is_finite()).fold(f64::INFINITY, f64::min);
        let share = if least.is_finite() { TORQUE_SHARE * least } else { 0.0 };
        let width = self.size.max(share);
        if width > 0.0 { width } else { UNSEEN }
    }
}

/// What the mass of a body makes of an entry of [`LinkParameters`](rivet_dynamics::LinkParameters) at its radius of
/// gyration about the joint.
fn body_size(body: &[f64], entry: usize) -> f64 {
    let mass = body[0].max(0.0);
    // Half the trace of the inertia: the mass's mean square distance from the origin.
    let square = if mass > 0.0 { (0.5 * (body[4] + body[6] + body[9])).max(0.0) / mass } else { 0.0 };
    match entry {
        0 => mass,
        1..=3 => mass * square.sqrt(),
        _ => mass * square,
    }
}
