//! A log that is four times as long may cost four times as much, not sixteen times.
#![allow(unsafe_code, reason = "a global allocator that counts is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

mod common;

use common::Noise;
use rivet_diagnosis::{Effect, Run, Silent, diagnose};
use rivet_dynamics::{Model, Structure, Workspace, inverse_dynamics};

struct Counting;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);
static ALL: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is the system allocator's; the counters beside touch no memory of it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let live = LIVE.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        MOST.fetch_max(live, Ordering::Relaxed);
        ALL.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

const PERIOD_S: f64 = 0.005;
/// Time from one push to the next, and how long one lasts \[s\].
const EVERY_S: f64 = 9.0;
const PUSH_S: f64 = 0.6;

/// A log of the model with noise, pushed at the last joint again and again.
fn log(model: &Model, x: &[f64], seconds: f64) -> Run {
    let arm = &model.arm;
    let n = arm.dof();
    let mut ws = Workspace::new(arm);
    let mut noise = Noise(1);
    let (mut q, mut tau) = (vec![Vec::new(); n], vec![Vec::new(); n]);
    let (mut at, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let (mut y, mut push) = (vec![0.0; n * model.len()], vec![0.0; n]);
    let still = vec![0.0; n];
    let mut tip = vec![[0.0; 10]; n];
    tip[n - 1][0] = 1.0;
    for k in 0..(seconds / PERIOD_S) as usize {
        let t = k as f64 * PERIOD_S;
        // No two joints ever repeat together.
        let waves = |j: usize| [(0.5, 1.1 + 0.37 * j as f64), (0.25, 2.3 - 0.41 * j as f64)];
        for j in 0..n {
            at[j] = waves(j).iter().map(|(a, w)| a * (w * t).sin()).sum();
            qd[j] = waves(j).iter().map(|(a, w)| a * w * (w * t).cos()).sum();
            qdd[j] = -waves(j).iter().map(|(a, w)| a * w * w * (w * t).sin()).sum::<f64>();
        }
        model.regressor(&mut ws, &at, &qd, &qdd, &mut y);
        let phase = t % EVERY_S - 0.5 * EVERY_S;
        let mut pushed = arm.clone();
        // A unit mass at the tip in this field is held like this force.
        let turn = (t / EVERY_S).floor();
        let size =
            if (0.0..PUSH_S).contains(&phase) { 120.0 * (std::f64::consts::PI * phase / PUSH_S).sin() } else { 0.0 };
        pushed.gravity = [size * turn.cos(), size * turn.sin(), 0.7 * size * (2.0 * turn).cos()];
        inverse_dynamics(&pushed, &tip, &mut ws, &at, &still, &still, &mut push);
        for j in 0..n {
            let whole: f64 = y[j * model.len()..][..model.len()].iter().zip(x).map(|(y, x)| y * x).sum();
            q[j].push(at[j]);
            tau[j].push(whole + push[j] + 0.3 * noise.draw());
        }
    }
    // With a thermometer no time constants are looked for, which only long logs have.
    let temperature = Some(vec![vec![30.0; q[0].len()]; n]);
    Run { name: "pushed".into(), period_s: PERIOD_S, q, tau, temperature, ..Run::default() }
}

/// Bytes held at once at most and bytes asked for in all, of a diagnosis that finds the pushes and nothing else: what hats
/// leave of them looks like a command that is cut.
fn cost(seconds: f64) -> [f64; 2] {
    let arm = common::arm();
    let n = arm.dof();
    let model = Model::new(arm, Structure { offset: true, sign_velocity: 0.02, ..Structure::default() });
    let mut x = model.arm.links.concat();
    for size in [0.4, 3.0, 4.0, 0.0] {
        x.extend((0..n).map(|_| size));
    }
    let run = log(&model, &x, seconds);
    let before = LIVE.load(Ordering::Relaxed);
    MOST.store(before, Ordering::Relaxed);
    let asked = ALL.load(Ordering::Relaxed);
    let found = diagnose(&model, &x, vec![run], &mut Silent).expect("a sound log");
    let causes: Vec<Effect> = found.causes.iter().map(|c| c.effect).collect();
    assert_eq!(causes, [Effect::ExternalForce], "{seconds} s");
    [MOST.load(Ordering::Relaxed) - before, ALL.load(Ordering::Relaxed) - asked].map(|bytes| bytes as f64)
}

/// Contact has as many unknowns as the log has pushes. Four times the log is four times the bytes; a tenth more is left to
/// inner values that take another way through their search.
#[test]
fn memory_and_work_grow_with_the_log_and_not_with_its_square() {
    let (short, long) = (cost(100.0), cost(400.0));
    for (what, short, long) in [("held at once", short[0], long[0]), ("asked for", short[1], long[1])] {
        println!("{what}: {:.1} MB, four times the log {:.1} MB", short / 1e6, long / 1e6);
        assert!(long <= 4.4 * short, "{what}: {:.1} times as much", long / short);
    }
}
