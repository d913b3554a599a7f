//! What must be positive definite, and how far it is from where it was expected.

use nalgebra::{DMatrix, DVector};
use rivet_dynamics::{LINK_PARAMETERS, LinkParameters, Model, Parameter, body_from_com, com_from_body, pseudo_inertia};

use super::ConsistencyError;

/// A nominal body thinner than this in some direction (root mean square, \[m\]) is taken to be so thick, and a
/// hundredth of its largest extent: a rod or a plate has no logarithm.
const THINNEST: f64 = 1e-3;
const THINNEST_SHARE: f64 = 0.01;
/// Smallest eigenvalue of a nominal drive matrix, in parts of its trace.
const DRIVE_SHARE: f64 = 1e-3;
/// A drive value without nominal is expected to make this share of all torque.
const DRIVE_TORQUE_SHARE: f64 = 0.01;

/// A symmetric matrix `P(χ) = Σ χᵢ·Eᵢ`, in coordinates in which its nominal value is 1.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub(super) size: usize,
    /// Standard index and matrix of each entry.
    pub(super) entries: Vec<(usize, DMatrix<f64>)>,
}

impl Block {
    /// `basis`: matrices before the change of coordinates; `nominal`: positive definite, by construction.
    fn new(basis: Vec<(usize, DMatrix<f64>)>, nominal: &DMatrix<f64>) -> Option<Block> {
        let root = nominal.clone().cholesky()?.l();
        let inverse = root.try_inverse()?;
        let entries = basis.into_iter().map(|(i, e)| (i, &inverse * e * inverse.transpose())).collect();
        Some(Block { size: nominal.nrows(), entries })
    }

    pub(super) fn value(&self, chi: &DVector<f64>) -> DMatrix<f64> {
        self.entries.iter().fold(DMatrix::zeros(self.size, self.size), |sum, (i, e)| sum + e * chi[*i])
    }

    /// `tr P − log det P − size`, zero at the nominal value; none where P is not positive definite.
    pub(super) fn divergence(&self, chi: &DVector<f64>) -> Option<f64> {
        let p = self.value(chi);
        let l = p.clone().cholesky()?.l();
        let log_det: f64 = l.diagonal().iter().map(|d| 2.0 * d.ln()).sum();
        let value = p.trace() - log_det - self.size as f64;
        value.is_finite().then_some(value)
    }
}

/// All blocks of a model, the standard vector at which they are nominal, and the links whose nominal body had to be
/// made thicker.
pub(super) struct Blocks {
    pub(super) all: Vec<Block>,
    pub(super) start: DVector<f64>,
    pub(super) thickened: Vec<String>,
}

impl Blocks {
    /// `curvature`: for each standard parameter, the squared share of all torque that a unit of it makes.
    pub(super) fn new(model: &Model, nominal: &[f64], curvature: &[f64]) -> Result<Blocks, ConsistencyError> {
        let mut found = Blocks { all: Vec::new(), start: DVector::from_column_slice(nominal), thickened: Vec::new() };
        let mut push = |basis, p0: &DMatrix<f64>, name: &dyn Fn() -> String| match Block::new(basis, p0) {
            Some(block) => {
                found.all.push(block);
                Ok(())
            }
            None => Err(ConsistencyError::Nominal { what: name() }),
        };
        for (link, joint) in model.arm.joints.iter().enumerate() {
            let first = link * LINK_PARAMETERS;
            let mut body: LinkParameters = [0.0; LINK_PARAMETERS];
            body.copy_from_slice(&nominal[first..first + LINK_PARAMETERS]);
            let name = || joint.link.clone();
            let Some((body, thicker)) = thick_body(&body) else {
                return Err(ConsistencyError::Nominal { what: name() });
            };
            if thicker {
                found.thickened.push(name());
            }
            found.start.as_mut_slice()[first..first + LINK_PARAMETERS].copy_from_slice(&body);
            let basis = (0..LINK_PARAMETERS).map(|entry| {
                let mut unit = [0.0; LINK_PARAMETERS];
                unit[entry] = 1.0;
                (first + entry, matrix(&unit))
            });
            push(basis.collect(), &matrix(&body), &name)?;
        }
        // Values of drives: one number each, and for a coupled pair also the matrix that multiplies both speeds.
        for (i, parameter) in model.parameters.iter().enumerate() {
            if matches!(parameter, Parameter::Link { .. } | Parameter::Offset(_) | Parameter::ViscousQuadratic(_)) {
                continue;
            }
            let least = if curvature[i] > 0.0 { DRIVE_TORQUE_SHARE / curvature[i].sqrt() } else { 1e-3 };
            found.start[i] = if nominal[i].is_finite() { nominal[i].max(least) } else { least };
            let p0 = DMatrix::from_element(1, 1, found.start[i]);
            push(vec![(i, DMatrix::from_element(1, 1, 1.0))], &p0, &|| parameter.name(&model.arm))?;
        }
        if let Some(pair) = model.structure.coupling {
            type Of = fn(usize) -> Parameter;
            let kinds: [(Of, Parameter); 2] = [
                (Parameter::RotorInertia, Parameter::CouplingInertia),
                (Parameter::Viscous, Parameter::CouplingViscous),
            ];
            for (own, shared) in kinds {
                let find = |wanted: Parameter| model.parameters.iter().position(|p| *p == wanted);
                let (Some(a), Some(b), Some(c)) = (find(own(pair.driving)), find(own(pair.driven)), find(shared))
                else {
                    continue;
                };
                let two = |entries: [f64; 4]| DMatrix::from_row_slice(2, 2, &entries);
                // The coupled value of the start must leave the matrix positive definite.
                let most = (1.0 - DRIVE_SHARE) * (found.start[a] * found.start[b]).sqrt();
                found.start[c] = found.start[c].min(most);
                let p0 = two([found.start[a], found.start[c], found.start[c], found.start[b]]);
                let basis = vec![
                    (a, two([1.0, 0.0, 0.0, 0.0])),
                    (b, two([0.0, 0.0, 0.0, 1.0])),
                    (c, two([0.0, 1.0, 1.0, 0.0])),
                ];
                push(basis, &p0, &|| shared.name(&model.arm))?;
            }
        }
        Ok(found)
    }
}

fn matrix(body: &LinkParameters) -> DMatrix<f64> {
    let p = pseudo_inertia(body);
    DMatrix::from_fn(4, 4, |i, k| p[i][k])
}

/// The body, made thicker where it has no extent, and whether that was needed. None without mass.
fn thick_body(body: &LinkParameters) -> Option<(LinkParameters, bool)> {
    if body.iter().any(|x| !x.is_finite()) || body[0] <= 0.0 {
        return None;
    }
    let (m, com, inertia) = com_from_body(body);
    let inertia = DMatrix::from_fn(3, 3, |i, k| inertia[i][k]);
    // Second moments about the centre of mass: Σ = ½·tr(I)·1 − I.
    let spread = DMatrix::identity(3, 3) * (0.5 * inertia.trace()) - inertia;
    let eigen = spread.symmetric_eigen();
    let largest = eigen.eigenvalues.max().max(0.0);
    let least = (largest * THINNEST_SHARE * THINNEST_SHARE).max(m * THINNEST * THINNEST);
    if eigen.eigenvalues.min() >= least {
        return Some((*body, false));
    }
    let values = DMatrix::from_diagonal(&eigen.eigenvalues.map(|v| v.max(least)));
    let spread = &eigen.eigenvectors * values * eigen.eigenvectors.transpose();
    let trace = spread.trace();
    let mut thick = [[0.0; 3]; 3];
    for i in 0..3 {
        for k in 0..3 {
            thick[i][k] = if i == k { trace - spread[(i, i)] } else { -spread[(i, k)] };
        }
    }
    Some((body_from_com(m, &com, &thick), true))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rods_become_thick_and_nothing_without_mass_passes() {
        let rod = body_from_com(2.0, &[0.1, 0.0, 0.2], &[[0.0; 3], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]);
        let (thick, changed) = thick_body(&rod).expect("a body");
        assert!(changed && rivet_dynamics::smallest_eigenvalue(&thick) > 0.0);
        let ball = body_from_com(2.0, &[0.1, 0.0, 0.2], &[[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]);
        assert_eq!(thick_body(&ball), Some((ball, false)));
        assert_eq!(thick_body(&[0.0; 10]), None);
    }
}
