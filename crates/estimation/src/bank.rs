//! A bank of models that share one parameter vector (paper, 3.2.4: "switch between sets of model equations").
//!
//! A member is a set of columns of the regressor; parameters of all others enter its equations as known:
//!
//! ```text
//! M = Σ λ^(N−i) z dᵀ,   S = Σ λ^(N−i) z zᵀ,   y = Σ λ^(N−i) z τ        one window for all members
//! M_aa·δ = (y − M·x)_a,   c = x + δ                                      candidate of the member with columns a
//! ```
//!
//! Within a member only directions move whose variance the window makes small enough (3.2.2). Evidence is what each
//! candidate leaves of rows that it has not been made from, a prequential error (Dawid 1984), with the instruments for the
//! regressor, whose noise would drown it. The shared vector x goes where the chosen member's candidate is; chosen is the
//! simplest member that explains as much as any, by a margin, and no sooner than a dwell after the last change.
//!
//! A building block; the daemon does not use it.

use crate::eigen::SymmetricEigen;
use crate::kernels::{Part, add_products};
use crate::linear::{axpy, dot};
use crate::lu::Lu;
use crate::scales::{LaneScratch, Scales, Whitening, workload};
use rivet_dynamics::{BaseSet, MAX_JOINTS, Model, Parameter, Workspace};

/// Eigenvalues below this share of the largest are rounding of the sums.
const EIGENVALUE_ROUNDING: f64 = 1e-13;
/// A direction moves only while `vᵀMv / vᵀSv` lies between this and its inverse: else its instruments describe another motion.
const RELEVANCE: f64 = 0.3;
/// A column that makes less than this share of its workload's torque on a standing arm makes none.
const STANDING: f64 = 1e-9;
/// The window of the evidence moves by this part of itself.
const BLOCKS: usize = 8;

/// Which parameters a member of the bank may move.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// What people call it.
    pub name: String,
    /// Its columns, each once and below n.
    pub columns: Vec<usize>,
}

impl Member {
    /// What a standing arm's torque depends on: weights and offsets.
    #[must_use]
    pub fn gravity(model: &Model, base: &BaseSet, scales: &Scales) -> Member {
        let (dof, n, full) = (model.arm.dof(), base.len(), model.len());
        let mut ws = Workspace::new(&model.arm);
        let (mut y, mut d, mut largest) = (vec![0.0; dof * full], vec![0.0; dof * n], vec![0.0_f64; n]);
        let zeros = vec![0.0; dof];
        workload(model, |q, _, _| {
            model.regressor(&mut ws, q, &zeros, &zeros, &mut y);
            base.select(&y, full, &mut d);
            for (row, noise) in d.chunks_exact(n).zip(&scales.torque_noise) {
                for (largest, x) in largest.iter_mut().zip(row) {
                    *largest = largest.max((x / noise).abs());
                }
            }
        });
        let columns = (0..n).filter(|&i| largest[i] > STANDING * scales.column[i]).collect();
        Member { name: "gravity".to_owned(), columns }
    }

    /// Friction, rotor and offset of joint `j`, what of them is in the base.
    #[must_use]
    pub fn drive(model: &Model, base: &BaseSet, j: usize) -> Member {
        let is_of_joint = |i: &usize| {
            matches!(
                base.parameter(model, *i),
                Parameter::RotorInertia(k)
                | Parameter::Viscous(k)
                | Parameter::Coulomb(k)
                | Parameter::Offset(k)
                | Parameter::LoadFriction(k)
                | Parameter::ViscousQuadratic(k) if k == j
            )
        };
        Member { name: format!("drive {}", j + 1), columns: (0..base.len()).filter(is_of_joint).collect() }
    }

    /// All `n` parameters.
    #[must_use]
    pub fn full(n: usize) -> Member {
        Member { name: "full".to_owned(), columns: (0..n).collect() }
    }
}

/// What a [`Bank`] is told about its work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BankSettings {
    /// λ: weight of the past at each update, in (0, 1].
    pub forgetting: f64,
    /// κ: how many rows tell as much as one with white noise.
    pub correlation: f64,
    /// Largest acceptable standard deviation of a direction within a member \[torque-noise sigma\]; infinite: all move that
    /// can be solved for.
    pub tolerance: f64,
    /// Window of the evidence \[rows\].
    pub memory: u32,
    /// What one member must explain better than another for the two to differ \[torque-noise sigma², mean over rows\].
    pub margin: f64,
    /// Rows from one change of the member to the next at least: those of a second make changes rarer than one a second.
    pub dwell: u32,
}

/// The bank: p rows (joints) at a time, n parameters.
#[derive(Clone, Debug)]
pub struct Bank {
    settings: BankSettings,
    members: Vec<Equations>,
    column: Vec<f64>,
    noise: Vec<f64>,
    /// Σ λ^(N−i) and Σ λ^2(N−i).
    count: [f64; 2],
    m: Vec<f64>,
    s: Vec<f64>,
    y: Vec<f64>,
    /// `y − M·x`
    rest: Vec<f64>,
    /// Shared parameters, scaled, and as they are.
    x: Vec<f64>,
    values: Vec<f64>,
    rows: [Vec<f64>; 2],
    /// Squares of the torque between the measured rows and the instruments', in the blocks of the evidence.
    squares: [f64; BLOCKS],
    /// Rows in each block, and which one grows.
    blocks: [u32; BLOCKS],
    block: usize,
    chosen: usize,
    since: u32,
    switches: u64,
}

/// A member at work.
#[derive(Clone, Debug)]
struct Equations {
    member: Member,
    eigen: SymmetricEigen,
    lu: Lu,
    /// Coordinates in which the reference workload excites all columns of the member alike, as far as it does.
    whitening: Whitening,
    lanes: LaneScratch,
    /// S_aa, then M_aa times every direction; the directions.
    room: Vec<f64>,
    directions: Vec<f64>,
    step: Vec<f64>,
    active: Vec<usize>,
    candidate: Vec<f64>,
    /// Squares of what the candidate left of the instruments' rows \[torque-noise sigma²\], in blocks.
    squares: [f64; BLOCKS],
}

impl Bank {
    /// Starts at `nominal` (n values). `scales.torque_noise` is taken for the truth. Members come in the order of
    /// preference: of two that explain as much, the first. The last one is chosen at the start; without any, there is the
    /// full one.
    #[must_use]
    pub fn new(nominal: &[f64], scales: &Scales, members: Vec<Member>, settings: BankSettings) -> Bank {
        let (n, p) = (nominal.len(), scales.torque_noise.len());
        let members = if members.is_empty() { vec![Member::full(n)] } else { members };
        let x: Vec<f64> = nominal.iter().zip(&scales.column).map(|(x, c)| x * c).collect();
        let equations = |member: Member| {
            let size = member.columns.len();
            Equations {
                eigen: SymmetricEigen::new(size),
                lu: Lu::new(size),
                whitening: of_columns(scales, &member.columns).whitening(),
                lanes: LaneScratch::new(size),
                room: vec![0.0; size * size],
                directions: vec![0.0; size * size],
                step: vec![0.0; size],
                active: Vec::with_capacity(size),
                candidate: x.clone(),
                squares: [0.0; BLOCKS],
                member,
            }
        };
        Bank {
            settings,
            chosen: members.len() - 1,
            members: members.into_iter().map(equations).collect(),
            column: scales.column.clone(),
            noise: scales.torque_noise.clone(),
            count: [0.0; 2],
            m: vec![0.0; n * n],
            s: vec![0.0; n * n],
            y: vec![0.0; n],
            rest: vec![0.0; n],
            values: nominal.to_vec(),
            rows: [vec![0.0; p * n], vec![0.0; p * n]],
            x,
            squares: [0.0; BLOCKS],
            blocks: [0; BLOCKS],
            block: 0,
            since: 0,
            switches: 0,
        }
    }

    /// Shared parameters.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The member that moves them, and its place.
    #[must_use]
    pub fn chosen(&self) -> (usize, &Member) {
        (self.chosen, &self.members[self.chosen].member)
    }

    /// How often another one was chosen.
    #[must_use]
    pub fn switches(&self) -> u64 {
        self.switches
    }

    /// Windowed mean square of what each member's candidate left of rows to come \[torque-noise sigma²\].
    pub fn evidence(&self) -> impl Iterator<Item = f64> + '_ {
        let rows = self.evidence_rows();
        self.members.iter().map(move |member| member.squares.iter().sum::<f64>() / rows)
    }

    fn evidence_rows(&self) -> f64 {
        f64::from(self.blocks.iter().sum::<u32>().max(1))
    }

    /// Takes in the rows of one instant: regressor `d` and instruments `z` (p x n row-major), torques `tau` (p). Every
    /// candidate is judged by them first. False, and nothing changed, if a number is not finite.
    pub fn update(&mut self, d: &[f64], z: &[f64], tau: &[f64]) -> bool {
        if !d.iter().chain(z).chain(tau).all(|x| x.is_finite()) {
            return false;
        }
        let (n, p) = (self.x.len(), tau.len());
        for (out, rows) in self.rows.iter_mut().zip([d, z]) {
            for ((out, row), noise) in out.chunks_exact_mut(n).zip(rows.chunks_exact(n)).zip(&self.noise) {
                out.iter_mut().zip(row).zip(&self.column).for_each(|((out, x), c)| *out = x / (noise * c));
            }
        }
        let [d, z] = &self.rows;
        let full = self.blocks[self.block] >= (self.settings.memory / BLOCKS as u32).max(1);
        if full {
            self.block = (self.block + 1) % BLOCKS;
        }
        let mean = |left: &dyn Fn(usize) -> f64| (0..p).map(|j| left(j).powi(2)).sum::<f64>() / p as f64;
        let add = |sum: &mut f64, square: f64| *sum = if full { square } else { *sum + square };
        for member in &mut self.members {
            let candidate_residual = |j: usize| tau[j] / self.noise[j] - dot(&z[j * n..(j + 1) * n], &member.candidate);
            add(&mut member.squares[self.block], mean(&candidate_residual));
        }
        let off = |j: usize| dot(&d[j * n..(j + 1) * n], &self.x) - dot(&z[j * n..(j + 1) * n], &self.x);
        add(&mut self.squares[self.block], mean(&off));
        self.blocks[self.block] = if full { 1 } else { self.blocks[self.block] + 1 };
        let lambda = self.settings.forgetting;
        add_products(&mut self.m, lambda, z, d, n, Part::All);
        add_products(&mut self.s, lambda, z, z, n, Part::All);
        self.y.iter_mut().for_each(|y| *y *= lambda);
        for ((z, tau), noise) in z.chunks_exact(n).zip(tau).zip(&self.noise) {
            axpy(tau / noise, z, &mut self.y);
        }
        self.count = [lambda * self.count[0] + 1.0, lambda * lambda * self.count[1] + 1.0];
        self.since = self.since.saturating_add(1);
        true
    }

    /// Makes every candidate anew from the shared vector, chooses, and moves. Of order n³.
    pub fn solve(&mut self) {
        let n = self.x.len();
        if self.count[0] == 0.0 {
            return;
        }
        self.choose();
        for (i, rest) in self.rest.iter_mut().enumerate() {
            *rest = self.y[i] - dot(&self.m[i * n..(i + 1) * n], &self.x);
        }
        // σₑ² of the equations: the torque's noise and what noise in the regressor makes. What is wrong with x is no noise.
        let square = 1.0 + self.squares.iter().sum::<f64>() / self.evidence_rows();
        let variance = self.settings.correlation * square * self.count[1] / self.count[0];
        let threshold = variance / self.settings.tolerance.powi(2);
        for member in &mut self.members {
            member.solve(&self.m, &self.s, &self.rest, &self.x, threshold);
        }
        self.x.copy_from_slice(&self.members[self.chosen].candidate);
        for ((value, x), c) in self.values.iter_mut().zip(&self.x).zip(&self.column) {
            *value = x / c;
        }
    }

    /// The chosen member stays while it explains as much as any. Half the margin makes a simpler one worth a change: what
    /// lies between does not waver.
    fn choose(&mut self) {
        if self.since < self.settings.dwell {
            return;
        }
        let margin = self.settings.margin;
        let best = self.evidence().fold(f64::INFINITY, f64::min);
        let evidence_gap = |k: usize| self.evidence().nth(k).map_or(f64::INFINITY, |evidence| evidence - best);
        let within = |most: f64| (0..self.members.len()).find(|&k| evidence_gap(k) <= most);
        let next = within(0.5 * margin).filter(|&k| k < self.chosen || evidence_gap(self.chosen) > margin);
        if let Some(next) = next.filter(|&k| k != self.chosen) {
            self.chosen = next;
            self.since = 0;
            self.switches += 1;
        }
    }
}

impl Equations {
    fn solve(&mut self, m: &[f64], s: &[f64], rest: &[f64], x: &[f64], threshold: f64) {
        let (n, columns) = (x.len(), &self.member.columns);
        let size = columns.len();
        self.candidate.copy_from_slice(x);
        for (row, &i) in self.room.chunks_exact_mut(size.max(1)).zip(columns) {
            row.iter_mut().zip(columns).for_each(|(out, &j)| *out = s[i * n + j]);
        }
        // S_aa·Tᵀ, then the same of its transpose.
        for _ in 0..2 {
            for rows in self.room.chunks_mut(MAX_JOINTS * size.max(1)) {
                self.whitening.rows(rows, &mut self.lanes);
            }
            transpose(&mut self.room, size);
        }
        self.eigen.start(&self.room);
        while !self.eigen.advance() {}
        if !self.eigen.converged() {
            return;
        }
        let values = self.eigen.values();
        let vectors = &mut self.directions;
        for (w, v) in vectors.chunks_exact_mut(size.max(1)).zip(self.eigen.vectors().chunks_exact(size.max(1))) {
            self.whitening.parameters(v, w);
        }
        let largest = values.iter().fold(0.0_f64, |m, v| m.max(*v));
        self.active.clear();
        for k in 0..size {
            let v = &vectors[k * size..(k + 1) * size];
            let mapped = &mut self.room[k * size..(k + 1) * size];
            for (out, &i) in mapped.iter_mut().zip(columns) {
                *out = columns.iter().zip(v).map(|(&j, v)| m[i * n + j] * v).sum();
            }
            let ratio = dot(v, mapped) / values[k];
            if values[k] > threshold.max(EIGENVALUE_ROUNDING * largest) && ratio > RELEVANCE && ratio < 1.0 / RELEVANCE
            {
                self.active.push(k);
            }
        }
        let moving = self.active.len();
        let matrix = self.lu.start(moving);
        for (a, &k) in self.active.iter().enumerate() {
            let v = &vectors[k * size..(k + 1) * size];
            for (b, &l) in self.active.iter().enumerate() {
                matrix[a * moving + b] = dot(v, &self.room[l * size..(l + 1) * size]);
            }
            self.step[a] = columns.iter().zip(v).map(|(&i, v)| rest[i] * v).sum();
        }
        while !self.lu.advance() {}
        if moving == 0 || self.lu.is_singular() {
            return;
        }
        self.lu.solve(&mut self.step[..moving]);
        if !self.step[..moving].iter().all(|x| x.is_finite()) {
            return;
        }
        for (step, &k) in self.step.iter().zip(&self.active) {
            for (&i, v) in columns.iter().zip(&vectors[k * size..(k + 1) * size]) {
                self.candidate[i] += step * v;
            }
        }
    }
}

/// What scales know of some of the columns.
fn of_columns(scales: &Scales, columns: &[usize]) -> Scales {
    let n = scales.column.len();
    Scales {
        column: columns.iter().map(|&i| scales.column[i]).collect(),
        workload: columns.iter().flat_map(|&i| columns.iter().map(move |&j| scales.workload[i * n + j])).collect(),
        payload: Vec::new(),
        ..scales.clone()
    }
}

fn transpose(matrix: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..i {
            matrix.swap(i * n + j, j * n + i);
        }
    }
}
