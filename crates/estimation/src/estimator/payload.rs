//! A load that is grasped or let go of changes ten numbers: what the window says of all others is true of the arm of now.
//!
//! With x before and `x' = x + P·δ` after, δ unknown, the window's equations `M·x = y` leave of x'
//!
//! ```text
//! L·M·x' = L·y,   L = I − M·P·(Pᵀ·M·P + Λ)⁻¹·Pᵀ,   S' = L·S·Lᵀ
//! ```
//!
//! (δ as a further unknown with the instruments −z·P, eliminated; Λ is what is known of a load beforehand). Directions
//! are independent unknowns, so one is eliminated after the other, one a period: the filters have no rows meanwhile, for
//! they begin anew with the first sample of the changed arm.

use super::{Estimator, ParameterState};
use crate::linear::{axpy, dot, packed};
use crate::memory::Carry;
use crate::scales::Whitening;

/// A direction with less than this share of its length left, those before it taken out, is one of those.
const INDEPENDENT: f64 = 1e-6;
/// Share of the parameters that must have been identified. With less, little stays, and a direction that is excited for the first
/// time with a value that was held looks like a change as well.
const KNOWN_SHARE: f64 = 0.9;
/// A load may move a direction by this many tolerances; more is as likely, but not known to be possible.
const MAX_PAYLOAD_TOLERANCES: f64 = 100.0;

/// What a load at the last link may change.
#[derive(Clone, Debug)]
pub(super) struct Payload {
    /// Orthonormal directions in working coordinates, r x n; single precision moves what they span by 1e-7.
    basis: Vec<f32>,
    /// Parameters that a load changes.
    touched: Vec<bool>,
    /// The direction that is eliminated next; r when none is.
    next: usize,
    /// How many of the parameters that a load changes were known when it changed.
    known: usize,
}

impl Payload {
    /// From `columns`: what each number of a load makes of the scaled parameters.
    pub(super) fn new(columns: &[Vec<f64>], whitening: Option<&Whitening>) -> Payload {
        let n = columns.first().map_or(0, Vec::len);
        let mut basis: Vec<f64> = Vec::new();
        let mut v = vec![0.0; n];
        for column in columns {
            match whitening {
                Some(whitening) => whitening.coordinates(column, &mut v),
                None => v.copy_from_slice(column),
            }
            let whole = dot(&v, &v).sqrt();
            // Twice: once leaves rounding of what was taken out.
            for _ in 0..2 {
                for p in basis.chunks_exact(n) {
                    axpy(-dot(p, &v), p, &mut v);
                }
            }
            let remainder_norm = dot(&v, &v).sqrt();
            if remainder_norm > INDEPENDENT * whole {
                basis.extend(v.iter().map(|x| x / remainder_norm));
            }
        }
        let touched = (0..n).map(|i| columns.iter().any(|column| column[i] != 0.0)).collect();
        let mut payload = Payload { basis: basis.iter().map(|x| *x as f32).collect(), touched, next: 0, known: 0 };
        payload.finish();
        payload
    }

    pub(super) fn carry(&mut self, carry: &mut Carry<'_>) {
        let mut next = self.next as u64;
        carry.whole(&mut next, self.touched.len() as u64 + 1);
        self.next = next as usize;
        let mut known = self.known as u64;
        carry.whole(&mut known, self.touched.len() as u64 + 1);
        self.known = known as usize;
    }

    /// How many of the parameters that a load changes are known.
    fn known(&self, state: &[ParameterState]) -> usize {
        let is_known =
            |(touched, state): &(&bool, &ParameterState)| **touched && **state != ParameterState::Unidentified;
        self.touched.iter().zip(state).filter(is_known).count()
    }

    /// Nothing is left to eliminate.
    pub(super) fn finish(&mut self) {
        self.next = self.basis.len().checked_div(self.touched.len()).unwrap_or(0);
    }

    fn direction(&self) -> Option<&[f32]> {
        let n = self.touched.len();
        self.basis.get(self.next * n..(self.next + 1) * n).filter(|p| !p.is_empty())
    }
}

impl Estimator {
    /// Whether what the window says of a load is still being taken out of it.
    pub(super) fn unloading(&self) -> bool {
        self.payload.as_ref().is_some_and(|payload| payload.direction().is_some())
    }

    /// Whether as much is known of the load as before it changed.
    pub(super) fn load_is_learnt(&self) -> bool {
        let learnt =
            |payload: &Payload| payload.direction().is_none() && payload.known(&self.state) >= payload.known.max(1);
        self.payload.as_ref().is_some_and(learnt)
    }

    /// The load has changed: everything that is known of it is forgotten, in the periods that come, and nothing else.
    /// False, and nothing changed, where that cannot be done or too little else is known.
    pub(super) fn forget_load(&mut self) -> bool {
        let unknown = self.state.iter().filter(|state| **state == ParameterState::Unidentified).count();
        if unknown as f64 > (1.0 - KNOWN_SHARE) * self.n as f64 {
            return false;
        }
        let Some(payload) = self.payload.as_mut().filter(|payload| !payload.basis.is_empty()) else { return false };
        payload.next = 0;
        payload.known = payload.known(&self.state);
        for i in (0..self.n).filter(|&i| payload.touched[i]) {
            self.std[i] = self.prior[i] / self.column[i];
            self.state[i] = ParameterState::Unidentified;
            self.cycle.forget(i, self.prior[i]);
        }
        self.cycle.begin_anew();
        // Least squares and what is made of single rows knows no directions.
        for ((scaled, x), c) in self.rows.scaled.iter_mut().zip(&self.values).zip(&self.column) {
            *scaled = x * c;
        }
        self.ud.reset(&self.rows.scaled);
        self.rls_values.copy_from_slice(&self.values);
        self.long_run.restart();
        self.comparison.restart();
        self.witnesses.restart();
        true
    }

    /// Eliminates one direction. Order n²; real-time safe.
    pub(super) fn unload(&mut self) {
        let known = self.row_variance() / (MAX_PAYLOAD_TOLERANCES * self.cycle.tolerance()).powi(2);
        let n = self.n;
        let Some(payload) = &mut self.payload else { return };
        let [p, mp, pm, sp] = self.cycle.room();
        let Some(direction) = payload.direction() else { return };
        p.iter_mut().zip(direction).for_each(|(p, x)| *p = f64::from(*x));
        payload.next += 1;
        pm.fill(0.0);
        sp.fill(0.0);
        for (i, row) in self.m.chunks_exact(n).enumerate() {
            mp[i] = dot(row, p);
            axpy(p[i], row, pm);
        }
        for i in 0..n {
            let row = &self.s[packed(i)];
            sp[i] += dot(row, &p[..=i]);
            axpy(p[i], &row[..i], &mut sp[..i]);
        }
        let pivot = dot(p, mp) + known;
        // Where instruments and regressor disagree about its sign, nothing good comes of the division: the direction stays in.
        if pivot >= known {
            let (psp, py) = (dot(p, sp), dot(p, &self.y));
            for (i, row) in self.m.chunks_exact_mut(n).enumerate() {
                axpy(-mp[i] / pivot, pm, row);
            }
            axpy(-py / pivot, mp, &mut self.y);
            for i in 0..n {
                let row = &mut self.s[packed(i)];
                let a = mp[i] / pivot;
                axpy(-a, &sp[..=i], row);
                axpy(a * psp / pivot - sp[i] / pivot, &mp[..=i], row);
            }
        }
        if !self.m.iter().chain(&self.s).chain(&self.y).all(|x| x.is_finite()) {
            self.begin_window();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::{Correlation, EstimatorSettings};
    use crate::report::{Instrument, Skip};
    use crate::scales::Scales;
    use crate::settings::{EigenSettings, EstimatorKind, Prior, Supervision};
    use nalgebra::{DMatrix, DVector};

    const N: usize = 6;
    const ROWS: usize = 3;

    fn estimator(columns: &[Vec<f64>]) -> Estimator {
        let scales = Scales { payload: columns.to_vec(), ..Scales::unit(ROWS, N) };
        let settings = EstimatorSettings {
            kind: EstimatorKind::Riv,
            forgetting: 0.999,
            deviation: None,
            supervision: Supervision::Eigen(EigenSettings::default()),
            prior: Prior { relative_std: 1.0 },
            noise_known: true,
            noise_memory: 1e3,
            outlier: f64::INFINITY,
            residual_memory: 100.0,
            correlation: Correlation { factor: 1.0, neighbour: 0.0 },
            change_row_s: Some(0.01),
            block: 20,
        };
        Estimator::new(&[1.0; N], &scales, &settings)
    }

    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    }

    /// Takes in `count` instants with true parameters `x`.
    fn learn(estimator: &mut Estimator, x: &[f64], count: usize, state: &mut u64) -> Result<usize, Skip> {
        let mut last = Ok(0);
        for _ in 0..count {
            let z: Vec<f64> = (0..ROWS * N).map(|_| 4.0 * random(state)).collect();
            let d: Vec<f64> = z.iter().map(|z| z + 0.3 * random(state)).collect();
            let tau: Vec<f64> = d.chunks_exact(N).map(|row| dot(row, x)).collect();
            last = estimator.update(&d, Some((&z, Instrument::Setpoint)), &tau, &[1.0; ROWS]);
            estimator.work();
        }
        last
    }

    /// The sums after the elimination are what the joint equations for x' and δ leave of x': Schur's complement.
    #[test]
    fn one_direction_after_the_other_is_all_at_once() {
        let columns = vec![
            vec![1.0, 0.5, 0.0, 0.0, 0.0, 0.2],
            vec![0.0, 1.0, -0.3, 0.0, 0.0, 0.0],
            vec![1.0, 1.5, -0.3, 0.0, 0.0, 0.2],
        ];
        let mut estimator = estimator(&columns);
        let mut state = 5;
        learn(&mut estimator, &[1.0, -2.0, 0.5, 3.0, 0.1, 1.5], 200, &mut state).expect("learnt");
        let m = DMatrix::from_row_slice(N, N, &estimator.m);
        let mut s = DMatrix::zeros(N, N);
        for i in 0..N {
            for (j, v) in estimator.s[packed(i)].iter().enumerate() {
                (s[(i, j)], s[(j, i)]) = (*v, *v);
            }
        }
        let y = DVector::from_column_slice(&estimator.y);
        let basis = &estimator.payload.as_ref().expect("a load").basis;
        assert_eq!(basis.len(), 2 * N, "the third column is the sum of the others");
        let basis: Vec<f64> = basis.iter().map(|x| f64::from(*x)).collect();
        let p = DMatrix::from_row_slice(2, N, &basis).transpose();
        let known = estimator.row_variance() / (MAX_PAYLOAD_TOLERANCES * estimator.cycle.tolerance()).powi(2);
        let inner = p.transpose() * &m * &p + DMatrix::identity(2, 2) * known;
        let l = DMatrix::identity(N, N) - &m * &p * inner.try_inverse().expect("excited") * p.transpose();
        assert!(estimator.forget_load());
        while estimator.unloading() {
            estimator.unload();
        }
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9 * m.norm();
        for i in 0..N {
            for j in 0..N {
                assert!(close(estimator.m[i * N + j], (&l * &m)[(i, j)]), "M {i} {j}");
                if j <= i {
                    assert!(close(estimator.s[packed(i)][j], (&l * &s * l.transpose())[(i, j)]), "S {i} {j}");
                }
            }
            assert!(close(estimator.y[i], (&l * &y)[i]), "y {i}");
        }
    }

    /// Without noise: what a load cannot change keeps its exact value, and the load is found from as many rows as it has
    /// numbers, where an arm that is learnt anew needs more.
    #[test]
    fn a_load_is_learnt_from_few_rows_and_the_rest_stays() {
        let columns = vec![vec![1.0, 0.5, 0.0, 0.0, 0.0, 0.2], vec![0.0, 1.0, -0.3, 0.0, 0.0, 0.0]];
        let mut estimator = estimator(&columns);
        let mut state = 5;
        let before = [1.0, -2.0, 0.5, 3.0, 0.1, 1.5];
        learn(&mut estimator, &before, 1000, &mut state).expect("learnt");
        let after: Vec<f64> = (0..N).map(|i| before[i] + 3.0 * columns[0][i] - 2.0 * columns[1][i]).collect();
        assert!(estimator.forget_load());
        assert_eq!(learn(&mut estimator, &after, 1, &mut state), Err(Skip::Changed), "no rows while it is taken out");
        while estimator.unloading() {
            estimator.work();
        }
        // One instant has three rows, the load two numbers, the arm six.
        learn(&mut estimator, &after, 1, &mut state).expect("learnt");
        estimator.settle();
        for (i, (x, true_x)) in estimator.estimate().values.iter().zip(&after).enumerate() {
            assert!((x - true_x).abs() < 1e-2, "{i}: {x} for {true_x}");
        }
    }

    /// What the past has left, taken out and put into another one.
    fn stored(from: &mut Estimator, mut into: Estimator) -> Estimator {
        let mut measure = Carry::measure();
        from.carry(&mut measure);
        let mut room = vec![0.0; measure.end().expect("counted")];
        let mut out = Carry::out(&mut room);
        from.carry(&mut out);
        assert_eq!(out.end(), Some(room.len()));
        let mut back = Carry::back(&room);
        into.carry(&mut back);
        assert_eq!(back.end(), Some(room.len()));
        into.take_up();
        into
    }

    /// Stored and taken up again, frozen for a while, or given settings again while a load is taken out: the rest of it goes
    /// on as if nothing had been.
    #[test]
    fn a_load_under_way_goes_on_after_storing_freezing_and_reloading() {
        let columns = vec![vec![1.0, 0.5, 0.0, 0.0, 0.0, 0.2], vec![0.0, 1.0, -0.3, 0.0, 0.0, 0.0]];
        let before = [1.0, -2.0, 0.5, 3.0, 0.1, 1.5];
        let after: Vec<f64> = (0..N).map(|i| before[i] + 3.0 * columns[0][i] - 2.0 * columns[1][i]).collect();
        let halfway = || {
            let mut estimator = estimator(&columns);
            let mut state = 5;
            learn(&mut estimator, &before, 500, &mut state).expect("learnt");
            estimator.settle();
            assert!(estimator.forget_load());
            estimator.unload();
            assert!(estimator.unloading(), "one of two directions");
            (estimator, state)
        };
        let rest = |mut estimator: Estimator, mut state: u64| {
            while estimator.unloading() {
                estimator.unload();
            }
            learn(&mut estimator, &after, 50, &mut state).expect("learnt");
            estimator.settle();
            estimator.estimate().values.iter().map(|x| x.to_bits()).collect::<Vec<u64>>()
        };
        let (plain, state) = halfway();
        let plain = rest(plain, state);
        let (mut one, state) = halfway();
        assert_eq!(rest(stored(&mut one, estimator(&columns)), state), plain, "stored");
        let (mut one, state) = halfway();
        one.freeze();
        let mut meanwhile = state;
        assert_eq!(learn(&mut one, &after, 3, &mut meanwhile), Err(Skip::Frozen));
        assert!(one.estimate().values.iter().all(|x| x.is_finite()));
        one.resume();
        let frozen = rest(one, state);
        for (x, y) in frozen.iter().zip(&plain).map(|(x, y)| (f64::from_bits(*x), f64::from_bits(*y))) {
            assert!((x - y).abs() < 1e-3 * y.abs().max(1.0), "frozen meanwhile: {x} for {y}");
        }
        let (mut one, state) = halfway();
        assert!(one.reconfigure(&mut estimator(&columns)), "nothing else is meant");
        assert_eq!(rest(one, state), plain, "given its settings again");
    }
}
