//! One pass over a record: regressors, zero-phase filter, the rows that are wanted. What it holds beside its results does
//! not grow with the record.
//!
//! The filter runs forwards over the whole record and backwards over one block after the other. Before a block's own
//! samples the backward pass runs over as many of the next ones as it takes for its start to be forgotten.

use rivet_dynamics::{BaseSet, Model, Slip, State, Workspace};

use super::record::Trajectory;
use super::zero_phase::ZeroPhase;
use crate::filter::Bank;
use crate::signals::structural_entries;

/// Samples of a block, as a multiple of those that the backward pass needs to forget its start.
const BLOCK: usize = 4;

/// Filtered rows of one joint: regressor and instruments.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    pub(super) d: Vec<f64>,
    pub(super) z: Vec<f64>,
}

/// Rows of every joint at the samples `used` (in order). Instruments are the regressor along `second` or, without one,
/// the regressor itself `delay` samples before.
pub(super) fn filtered_rows(
    model: &Model,
    base: &BaseSet,
    filter: &ZeroPhase,
    (measured, second): (&Trajectory, Option<&Trajectory>),
    delay: usize,
    used: &[Vec<usize>],
) -> Vec<Pair> {
    let (n, k) = (model.arm.dof(), base.len());
    let mut source = Source::new(model, base, measured, second, filter.padding(measured.len()));
    let width = source.width();
    let mut rows: Vec<Pair> =
        used.iter().map(|used| Pair { d: vec![0.0; used.len() * k], z: vec![0.0; used.len() * k] }).collect();
    let settle = filter.settling();
    let (block, total) = (BLOCK * settle, source.len());
    let (mut forwards, mut backwards) =
        (Bank::new(filter.butterworth(), width), Bank::new(filter.butterworth(), width));
    let mut buffer = vec![0.0; (block + settle).min(total) * width];
    let mut scratch = vec![0.0; width];
    let (mut first, mut filled, mut next) = (0, 0, 0);
    while first < total {
        while next < total && (filled + 1) * width <= buffer.len() {
            let sample = &mut buffer[filled * width..(filled + 1) * width];
            source.sample(next, sample);
            forwards.step(sample);
            (filled, next) = (filled + 1, next + 1);
        }
        let done = if next == total { filled } else { block };
        let (own, later) = buffer[..filled * width].split_at_mut(done * width);
        backwards.restart();
        for sample in later.chunks_exact(width).rev() {
            scratch.copy_from_slice(sample);
            backwards.step(&mut scratch);
        }
        for sample in own.chunks_exact_mut(width).rev() {
            backwards.step(sample);
        }
        for j in 0..n {
            let Pair { d, z } = &mut rows[j];
            let entries = source.entries.iter().enumerate().filter(|(_, e)| e.joint == j);
            let entries: Vec<(usize, usize)> = entries.map(|(at, e)| (at * source.lanes, e.column)).collect();
            let write = |to: &mut [f64], late: usize, lane: usize| {
                // The block in samples of the record, and the wanted ones that see it `late` samples after.
                let at = |k: usize| k + source.padding - late;
                let from = used[j].partition_point(|k| at(*k) < first);
                let until = used[j].partition_point(|k| at(*k) < first + done);
                for (row, sample) in to.chunks_exact_mut(k).zip(&used[j]).take(until).skip(from) {
                    let sample = &own[(at(*sample) - first) * width..];
                    for &(channel, column) in &entries {
                        row[column] = sample[channel + lane];
                    }
                }
            };
            write(d, 0, 0);
            if second.is_some() { write(z, 0, 1) } else { write(z, delay, 0) }
        }
        buffer.copy_within(done * width..filled * width, 0);
        (first, filled) = (first + done, filled - done);
    }
    rows
}

/// Entries of the regressors, sample after sample; the record is continued beyond its ends by turning it about its end
/// points, as [`ZeroPhase::apply`] does.
struct Source<'a> {
    model: &'a Model,
    measured: &'a Trajectory,
    second: &'a Trajectory,
    lanes: usize,
    entries: Vec<crate::signals::Entry>,
    padding: usize,
    ws: Workspace,
    /// Friction along both motions, whose samples are evaluated once each and in order.
    slips: [Slip; 2],
    pair: Vec<[f64; 2]>,
    states: [[Vec<f64>; 3]; 2],
    /// Entries of the first and of the last samples, one more than the padding is long.
    head: Vec<f64>,
    tail: Vec<f64>,
}

impl<'a> Source<'a> {
    fn new(
        model: &'a Model,
        base: &BaseSet,
        measured: &'a Trajectory,
        second: Option<&'a Trajectory>,
        padding: usize,
    ) -> Source<'a> {
        let n = model.arm.dof();
        let state = || [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        let mut source = Source {
            model,
            measured,
            second: second.unwrap_or(measured),
            lanes: if second.is_some() { 2 } else { 1 },
            entries: structural_entries(model, base),
            padding,
            ws: Workspace::new(&model.arm),
            slips: [Slip::new(model), Slip::new(model)],
            pair: vec![[0.0; 2]; n * model.len()],
            states: [state(), state()],
            head: Vec::new(),
            tail: Vec::new(),
        };
        let width = source.width();
        let mut ends = vec![0.0; (padding + 1) * width];
        for (k, sample) in ends.chunks_exact_mut(width).enumerate() {
            source.evaluate(k, sample);
        }
        source.tail = vec![0.0; ends.len()];
        source.head = ends;
        source
    }

    fn width(&self) -> usize {
        self.entries.len() * self.lanes
    }

    fn len(&self) -> usize {
        self.measured.len() + 2 * self.padding
    }

    /// Sample `at` of the continued record; to be asked for in order.
    fn sample(&mut self, at: usize, out: &mut [f64]) {
        let (width, rows) = (self.width(), self.measured.len());
        let turn = |out: &mut [f64], end: &[f64], inner: &[f64]| {
            for ((out, end), inner) in out.iter_mut().zip(end).zip(inner) {
                *out = 2.0 * end - inner;
            }
        };
        if at < self.padding {
            let inner = (self.padding - at) * width;
            turn(out, &self.head[..width], &self.head[inner..inner + width]);
        } else if at < self.padding + rows {
            let k = at - self.padding;
            if k <= self.padding {
                out.copy_from_slice(&self.head[k * width..(k + 1) * width]);
            } else {
                self.evaluate(k, out);
            }
            // Row 0 of the tail is the last sample, the next one the sample before.
            let back = rows - 1 - k;
            if back <= self.padding {
                self.tail[back * width..(back + 1) * width].copy_from_slice(out);
            }
        } else {
            let inner = (at - self.padding - rows + 1) * width;
            turn(out, &self.tail[..width], &self.tail[inner..inner + width]);
        }
    }

    /// The entries at sample `k` of the record.
    fn evaluate(&mut self, k: usize, out: &mut [f64]) {
        for ([q, qd, qdd], motion) in self.states.iter_mut().zip([self.measured, self.second]) {
            motion.state(k, q, qd, qdd);
        }
        let [a, b] = &self.states;
        let states = [a, b].map(|[q, qd, qdd]| State { q, qd, qdd });
        self.model.regressor_pair_sliding(&mut self.ws, &mut self.slips, states, &mut self.pair);
        if self.lanes == 2 {
            for (out, entry) in out.as_chunks_mut::<2>().0.iter_mut().zip(&self.entries) {
                *out = self.pair[entry.standard];
            }
        } else {
            for (out, entry) in out.iter_mut().zip(&self.entries) {
                *out = self.pair[entry.standard][0];
            }
        }
    }
}
