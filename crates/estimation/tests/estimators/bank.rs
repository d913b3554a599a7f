//! A bank of models that share one parameter vector.

use crate::common::{Bench, Random};
use rivet_estimation::bank::{Bank, BankSettings, Member};
use rivet_estimation::{Motion, Scales};

const SETTINGS: BankSettings =
    BankSettings { forgetting: 0.99, correlation: 1.0, tolerance: 0.5, memory: 100, margin: 0.1, dwell: 120 };

fn member(name: &str, columns: &[usize]) -> Member {
    Member { name: name.to_owned(), columns: columns.to_vec() }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Without noise a member finds its parameters exactly where the others are right, and moves no other one.
#[test]
fn what_is_not_a_members_enters_as_known() {
    let truth = [2.0, -1.0, 0.5, 3.0];
    let start = [2.0, 4.0, 0.5, -2.0];
    let mut random = Random(3);
    let mut bank = Bank::new(&start, &Scales::unit(2, 4), vec![member("second and fourth", &[1, 3])], SETTINGS);
    for _ in 0..200 {
        let d: Vec<f64> = (0..8).map(|_| 5.0 * random.normal()).collect();
        let tau: Vec<f64> = d.chunks_exact(4).map(|d| dot(d, &truth)).collect();
        assert!(bank.update(&d, &d, &tau));
        bank.solve();
    }
    let x = bank.values();
    assert_eq!((x[0], x[2]), (start[0], start[2]));
    assert!((x[1] - truth[1]).abs() < 1e-9 && (x[3] - truth[3]).abs() < 1e-9, "{x:?}");
    let before = x.to_vec();
    assert!(
        !bank.update(&[f64::NAN; 8], &[1.0; 8], &[1.0; 2]) && !bank.update(&[1.0; 8], &[1.0; 8], &[f64::INFINITY; 2])
    );
    bank.solve();
    assert!(bank.values().iter().zip(&before).all(|(x, y)| (x - y).abs() < 1e-12));
}

/// One parameter changes, then the other one: the member that has it takes over, and the shared vector keeps what earlier
/// ones have found. Of members that explain as much, the first is chosen.
#[test]
fn the_simplest_member_that_explains_it_is_chosen() {
    let members = vec![member("first", &[0]), member("second", &[1]), member("both", &[0, 1])];
    let mut bank = Bank::new(&[3.0, -3.0], &Scales::unit(1, 2), members, SETTINGS);
    let mut random = Random(5);
    let mut chosen = [[0; 3]; 3];
    for k in 0..9000_u32 {
        let truth = [if k < 3000 { 1.0 } else { 4.0 }, if k < 6000 { 1.0 } else { -2.0 }];
        let d = [2.0 * random.normal(), 2.0 * random.normal()];
        assert!(bank.update(&d, &d, &[dot(&d, &truth) + random.normal()]));
        bank.solve();
        chosen[k as usize / 3000][bank.chosen().0] += 1;
        if k % 3000 == 2999 {
            assert_eq!(bank.chosen().1.name, "first");
            for (x, t) in bank.values().iter().zip(truth) {
                assert!((x - t).abs() < 0.4, "{k}: {:?}", bank.values());
            }
        }
    }
    println!("rows at which each was chosen: {chosen:?}, {} switches", bank.switches());
    // Both are wrong at first; then one is, but for what the first rows say of the other one; then that one.
    assert!(chosen[0][2] > 100 && chosen[1][0] > 2500 && chosen[2][1] > 100 && chosen[2][2] == 0, "{chosen:?}");
}

/// Evidence that changes sides every 15 rows: without margin and dwell the members take turns, with both they do so at most once
/// in a dwell.
#[test]
fn it_does_not_chatter() {
    let run = |memory: u32, margin: f64, dwell: u32| {
        let settings = BankSettings { forgetting: 0.9, memory, margin, dwell, ..SETTINGS };
        let members = vec![member("first", &[0]), member("second", &[1])];
        let mut bank = Bank::new(&[0.0, 0.0], &Scales::unit(1, 2), members, settings);
        let mut random = Random(7);
        let (mut before, mut at, mut shortest) = (0, 0, u32::MAX);
        for k in 0..6000_u32 {
            let d = if k / 15 % 2 == 0 { [4.0, 0.0] } else { [0.0, 4.0] };
            let truth = (f64::from(k) * 0.05).sin();
            assert!(bank.update(&d, &d, &[4.0 * truth + random.normal()]));
            bank.solve();
            if bank.switches() > before {
                shortest = if before > 0 { shortest.min(k - at) } else { shortest };
                (before, at) = (bank.switches(), k);
            }
        }
        (bank.switches(), shortest)
    };
    let ((often, soon), (seldom, late)) = (run(16, 0.0, 1), run(16, 0.1, 120));
    println!("{often} switches, {soon} rows apart at least; with margin and dwell {seldom}, {late}");
    assert!(often > 200 && soon < 20, "the failure: {often} {soon}");
    assert!(seldom > 0 && late >= 120, "{seldom} {late}");
}

/// Gravity has every column that a standing arm's torque depends on, and none else; drives share nothing.
#[test]
fn members_of_an_arm() {
    let Some(mut bench) = Bench::new("manutec-r3") else { return };
    let (dof, n) = (bench.dof(), bench.len());
    let scales = Scales::of_model(&bench.model, &bench.base, &bench.truth, None);
    let gravity = Member::gravity(&bench.model, &bench.base, &scales);
    let mut random = Random(9);
    let zeros = vec![0.0; dof];
    let mut seen = vec![false; n];
    for _ in 0..50 {
        let q: Vec<f64> = (0..dof).map(|_| random.normal()).collect();
        for row in bench.rows(Motion { q: &q, qd: &zeros, qdd: &zeros }).chunks_exact(n) {
            row.iter().zip(&mut seen).for_each(|(x, seen)| *seen |= x.abs() > 1e-9);
        }
    }
    assert_eq!(gravity.columns, (0..n).filter(|i| seen[*i]).collect::<Vec<_>>());
    assert!(gravity.columns.len() > dof && gravity.columns.len() < n / 2, "{gravity:?}");
    let mut drives: Vec<usize> = (0..dof).flat_map(|j| Member::drive(&bench.model, &bench.base, j).columns).collect();
    let count = drives.len();
    drives.sort_unstable();
    drives.dedup();
    assert!(count == drives.len() && count >= 3 * dof, "{count} columns of drives, {} of them once", drives.len());
    assert_eq!(Member::full(n).columns.len(), n);
}
