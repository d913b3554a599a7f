//! Every fault ends in the stop reaction: a true arm, in motion, whose joint states or drives go wrong.

mod common;

use common::rig::{Outcome, Rig, Wrong};
use rivet_ipc_schema::StopCause;

const ARMS: [&str; 2] = ["dd2", "ur10e"];
const PERIODS: [f64; 2] = [0.004, 0.001];
/// Seconds of sound motion before the fault: at several phases of it.
const SOUND_S: [f64; 4] = [1.6, 1.9, 2.3, 2.9];
const WRONG_S: f64 = 1.5;
const SHARE: f64 = 0.4;

fn each(arms: &[&str], wrong: impl Fn(usize) -> Vec<Wrong>) -> Vec<(String, Wrong, Outcome)> {
    let mut out = Vec::new();
    for arm in arms {
        let joints = if *arm == "dd2" { 2 } else { 6 };
        for period_s in PERIODS {
            for wrong in wrong(joints) {
                for sound_s in SOUND_S {
                    let mut rig = Rig::new(arm, period_s, "", SHARE);
                    let outcome = rig.run(sound_s, wrong, WRONG_S, |_, _| ());
                    out.push((format!("{arm} {period_s} s, {wrong:?} after {sound_s} s"), wrong, outcome));
                }
            }
        }
    }
    out
}

#[test]
fn survey() {
    let all = each(&ARMS, |joints| {
        let mut all = vec![
            Wrong::Silence,
            Wrong::Repeated,
            Wrong::AllFrozen,
            Wrong::Late(0.1),
            Wrong::Late(0.03),
            Wrong::Shape,
            Wrong::FaultBits,
            Wrong::Rate(2.0),
        ];
        for j in 0..joints {
            all.extend([
                Wrong::Frozen(j),
                Wrong::Backwards(j),
                Wrong::Negative(j),
                Wrong::Jump(j, 0.5),
                Wrong::Jump(j, 0.02),
                Wrong::NotFinite(j),
                Wrong::Implausible(j),
                Wrong::TorqueSign(j),
                Wrong::TorqueStuck(j),
                Wrong::TorqueAtLimit(j),
                Wrong::Drive(j, 0.0),
                Wrong::Drive(j, -1.0),
            ]);
        }
        all
    });
    for (name, _, o) in all {
        let ok = o.speed <= 1.2 && o.away <= 0.3 && o.rest < 0.02 && o.stop.is_some_and(|s| s.2 <= 0.0201);
        println!(
            "{} {name}: {:?} speed {:.2} away {:.3} rest {:.4} stops {}",
            if ok { "ok  " } else { "FAIL" },
            o.stop,
            o.speed,
            o.away,
            o.rest,
            o.stops
        );
    }
    let _ = StopCause::None;
}

#[test]
fn sound() {
    for arm in ARMS {
        for period_s in PERIODS {
            let o = Rig::new(arm, period_s, "", SHARE).run(6.0, Wrong::Nothing, 2.0, |_, _| ());
            println!("{arm} {period_s}: {o:?}");
        }
    }
}
