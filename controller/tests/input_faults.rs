//! Every fault ends in the stop reaction: a true arm, in motion, whose joint states or drives go wrong.

mod common;

use common::rig::{Outcome, Rig, Wrong};
use rivet_ipc_schema::StopCause;

const ARMS: [&str; 2] = ["dd2", "ur10e"];
const PERIODS: [f64; 2] = [0.004, 0.001];
/// Seconds of sound motion before the fault: at several phases of it.
const WRONG_S: f64 = 1.0;
const SHARE: f64 = 0.4;

fn each(arms: &[&str], wrong: impl Fn(&[usize]) -> Vec<Wrong>) -> Vec<(String, Wrong, Outcome)> {
    let mut out = Vec::new();
    for arm in arms {
        let dd2 = *arm == "dd2";
        let joints: &[usize] = if dd2 { &[0, 1] } else { &[0, 1, 3, 5] };
        let phases: &[f64] = if dd2 { &[1.3, 1.5, 1.7, 2.0] } else { &[1.3, 1.8] };
        for period_s in PERIODS {
            for wrong in wrong(joints) {
                for &sound_s in phases {
                    let mut rig = Rig::new(arm, period_s, "", SHARE);
                    let outcome = rig.run(sound_s, wrong, WRONG_S, |_, _| ());
                    let o = outcome;
                    let ok = o.speed <= 1.2 && o.away <= 0.3 && o.rest < 0.02 && o.stop.is_some_and(|s| s.2 <= 0.0201);
                    println!(
                        "{} {arm} {period_s} {wrong:?} {sound_s}: {:?} speed {:.2} away {:.3} rest {:.4} stops {}",
                        if ok { "ok  " } else { "FAIL" },
                        o.stop,
                        o.speed,
                        o.away,
                        o.rest,
                        o.stops
                    );
                    out.push((format!("{arm} {period_s} s, {wrong:?} after {sound_s} s"), wrong, outcome));
                }
            }
        }
    }
    out
}

#[test]
fn survey_dd2() {
    survey(&ARMS[..1])
}
#[test]
fn survey_ur10e() {
    survey(&ARMS[1..])
}
fn survey(arms: &[&str]) {
    let _ = each(arms, |joints| {
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
        if std::env::var_os("QUICK").is_some() {
            all.truncate(5);
            for &j in joints {
                all.extend([
                    Wrong::Frozen(j),
                    Wrong::Backwards(j),
                    Wrong::Negative(j),
                    Wrong::Jump(j, 0.5),
                    Wrong::Jump(j, 0.02),
                ]);
            }
            return all;
        }
        for &j in joints {
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
