//! One pass over a record: regressors, zero-phase filter, the rows that are wanted. What it holds beside its results does
//! not grow with the record.
//!
//! The record is cut into spans, whose number depends on its length alone, so that processors can share them. In each the
//! filter runs forwards over the whole span and backwards over one block after the other. Before its own samples a pass runs
//! over as many of those before (or behind) as it takes for its start to be forgotten.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use rivet_dynamics::{BaseSet, Model, Slip, State, Workspace};

use super::record::Trajectory;
use super::zero_phase::ZeroPhase;
use crate::filter::{Bank, FILTER_CHUNK, Order};
use crate::signals::structural_entries;

/// Samples of a block, as a multiple of those that the backward pass needs to forget its start.
const BLOCK: usize = 4;
/// Samples of a span, likewise: a record of a minute has four of them at 20 Hz.
const SPAN: usize = 20;
/// From so many spans on there is a multiple of them: few processors then are done at the same time.
const EVEN: usize = 4;

/// Filtered rows of one joint: regressor and instruments, row-major, of the base columns that are named.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    pub(super) columns: Vec<usize>,
    pub(super) d: Vec<f64>,
    pub(super) z: Vec<f64>,
}

impl Pair {
    fn new(columns: Vec<usize>, rows: usize) -> Pair {
        // Each fresh: zeros that the system has anyway, and no copy of them.
        let empty = || vec![0.0; rows * columns.len()];
        Pair { d: empty(), z: empty(), columns }
    }
}

/// Where rows are written: of one joint, the samples they belong to and regressor or instruments.
struct Wanted<'a> {
    /// The joint's channels; instruments stand in other ones where they are of another motion, and are so many samples late.
    channels: Vec<usize>,
    late: usize,
    used: &'a [usize],
    rows: &'a mut [f64],
    /// Rows that are still to be taken of the samples at hand, which come from the last to the first.
    left: usize,
}

impl Wanted<'_> {
    fn place(&self, row: usize, padding: usize) -> usize {
        self.used[row] + padding - self.late
    }

    /// The next samples end where `end` is in the record continued by `padding`.
    fn begin(&mut self, end: usize, padding: usize) {
        self.left = self.used.partition_point(|k| k + padding - self.late < end);
    }

    /// Takes its rows out of a few filtered samples, of which the first stands at `at`; those after them were there before.
    fn take(&mut self, samples: &[f64], width: usize, at: usize, padding: usize) {
        while self.left > 0 && self.place(self.left - 1, padding) >= at {
            self.left -= 1;
            let sample = &samples[(self.place(self.left, padding) - at) * width..][..width];
            let row = &mut self.rows[self.left * self.channels.len()..];
            row.iter_mut().zip(&self.channels).for_each(|(to, channel)| *to = sample[*channel]);
        }
    }
}

/// Rows of every joint at the samples `used` (in order), of the columns that its entries name. Instruments are the
/// regressor along `second` or, without one, the regressor itself `delay` samples before.
pub(super) fn filtered_rows(
    model: &Model,
    base: &BaseSet,
    filter: &ZeroPhase,
    (measured, second): (&Trajectory, Option<&Trajectory>),
    delay: usize,
    used: &[Vec<usize>],
) -> Vec<Pair> {
    let source = Source::new(model, base, measured, second, filter.padding(measured.len()));
    let columns = |j: usize| source.entries.iter().filter(|e| e.joint == j).map(|e| e.column).collect();
    let mut pairs: Vec<Pair> = (0..used.len()).map(|j| Pair::new(columns(j), used[j].len())).collect();
    let spans = spans(source.len(), filter);
    let mut shares: Vec<Vec<Wanted<'_>>> = spans.iter().map(|_| Vec::new()).collect();
    for (joint, (pair, used)) in pairs.iter_mut().zip(used).enumerate() {
        let width = pair.columns.len();
        let (lane, late) = if second.is_some() { (1, 0) } else { (0, delay) };
        let entries = source.entries.iter().enumerate().filter(|(_, e)| e.joint == joint);
        let channels = |lane| entries.clone().map(|(k, _)| k * source.lanes + lane).collect();
        for (lane, late, mut rows) in [(0, 0, &mut pair.d[..]), (lane, late, &mut pair.z[..])] {
            let mut from = 0;
            for (span, share) in spans.iter().zip(&mut shares) {
                let until = used.partition_point(|k| k + source.padding - late < span.end);
                let span_rows = rows.split_off_mut(..(until - from) * width).unwrap_or_default();
                share.push(Wanted {
                    channels: channels(lane),
                    late,
                    used: &used[from..until],
                    rows: span_rows,
                    left: 0,
                });
                from = until;
            }
        }
    }
    // The next span takes the buffer of one that is done: of fresh memory the system has to make every page first.
    let buffers = Mutex::new(Vec::new());
    spans.into_par_iter().zip(shares).for_each(|(span, share)| {
        let spare = || buffers.lock().unwrap_or_else(PoisonError::into_inner);
        let mut buffer = spare().pop().unwrap_or_default();
        source.clone().run(filter, span, share, &mut buffer);
        spare().push(buffer);
    });
    pairs
}

/// The continued record of `total` samples, cut into spans that are filtered each on its own.
fn spans(total: usize, filter: &ZeroPhase) -> Vec<Range<usize>> {
    let count = (total / (SPAN * filter.settling())).max(1);
    let count = if count > EVEN { count - count % EVEN } else { count };
    (0..count).map(|i| i * total / count..(i + 1) * total / count).collect()
}

/// Entries of the regressors, sample after sample; the record is continued beyond its ends by turning it about its end
/// points, as [`ZeroPhase::apply`] does.
#[derive(Clone)]
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
    /// With one motion and friction without memory the second lane has the sample after the one that was asked for: which it is.
    ahead: Option<usize>,
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
            ahead: None,
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

    /// Filters a span of the continued record and writes the rows that are wanted of it. What `buffer` holds does not matter.
    fn run(mut self, filter: &ZeroPhase, span: Range<usize>, mut wanted: Vec<Wanted<'_>>, buffer: &mut Vec<f64>) {
        let width = self.width();
        let settle = filter.settling();
        let block = BLOCK * settle;
        let (mut forwards, mut backwards) =
            (Bank::new(filter.butterworth(), width), Bank::new(filter.butterworth(), width));
        let end = (span.end + settle).min(self.len());
        let begin = span.start.saturating_sub(settle);
        let most = (block + settle).min(end - span.start);
        buffer.resize(most.max(span.start - begin) * width, 0.0);
        self.begin(begin);
        self.forwards(&mut forwards, begin, &mut buffer[..(span.start - begin) * width]);
        let mut few = vec![0.0; FILTER_CHUNK * width];
        let (mut first, mut filled) = (span.start, 0);
        while first < span.end {
            let (next, now) = (first + filled, most.min(end - first));
            self.forwards(&mut forwards, next, &mut buffer[filled * width..now * width]);
            filled = now;
            let done = if first + filled == end { span.end - first } else { block };
            let (own, later) = buffer[..filled * width].split_at_mut(done * width);
            backwards.restart();
            for samples in later.rchunks(FILTER_CHUNK * width) {
                few[..samples.len()].copy_from_slice(samples);
                backwards.pass(&mut few[..samples.len()], Order::Backwards);
            }
            let mut at = first + done;
            for wanted in &mut wanted {
                wanted.begin(at, self.padding);
            }
            for samples in own.rchunks(FILTER_CHUNK * width) {
                let few = &mut few[..samples.len()];
                few.copy_from_slice(samples);
                backwards.pass(few, Order::Backwards);
                at -= few.len() / width;
                for wanted in &mut wanted {
                    wanted.take(few, width, at, self.padding);
                }
            }
            buffer.copy_within(done * width..filled * width, 0);
            (first, filled) = (first + done, filled - done);
        }
    }

    /// The samples of the continued record from `from` on, filtered.
    fn forwards(&mut self, bank: &mut Bank, from: usize, samples: &mut [f64]) {
        let width = self.width();
        let mut at = from;
        for few in samples.chunks_mut(FILTER_CHUNK * width) {
            for sample in few.chunks_exact_mut(width) {
                self.sample(at, sample);
                at += 1;
            }
            bank.pass(few, Order::Forwards);
        }
    }

    fn width(&self) -> usize {
        self.entries.len() * self.lanes
    }

    fn len(&self) -> usize {
        self.measured.len() + 2 * self.padding
    }

    /// The next sample of the continued record will be `at`: friction has slid as far as before it.
    fn begin(&mut self, at: usize) {
        if self.model.structure.presliding_travel <= 0.0 {
            return;
        }
        let mut q = vec![0.0; self.model.arm.dof()];
        for k in self.padding + 1..at.saturating_sub(self.padding) {
            for (slip, motion) in self.slips.iter_mut().zip([self.measured, self.second]) {
                q.iter_mut().zip(&motion.q).for_each(|(to, from)| *to = from[k]);
                slip.advance(&q);
            }
        }
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
        if self.lanes == 1 && self.ahead == Some(k) {
            return self.take_lane(1, out);
        }
        let alone = self.lanes == 1 && self.model.structure.presliding_travel <= 0.0;
        let next = (k + 1).min(self.measured.len() - 1);
        let places = if alone { [k, next] } else { [k, k] };
        for (([q, qd, qdd], motion), at) in self.states.iter_mut().zip([self.measured, self.second]).zip(places) {
            motion.state(at, q, qd, qdd);
        }
        let [a, b] = &self.states;
        let states = [a, b].map(|[q, qd, qdd]| State { q, qd, qdd });
        self.model.regressor_pair_sliding(&mut self.ws, &mut self.slips, states, &mut self.pair);
        self.ahead = alone.then_some(next);
        if self.lanes == 2 {
            for (out, entry) in out.as_chunks_mut::<2>().0.iter_mut().zip(&self.entries) {
                *out = self.pair[entry.standard];
            }
        } else {
            self.take_lane(0, out);
        }
    }

    fn take_lane(&self, lane: usize, out: &mut [f64]) {
        for (out, entry) in out.iter_mut().zip(&self.entries) {
            *out = self.pair[entry.standard][lane];
        }
    }
}
