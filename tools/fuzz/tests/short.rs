//! The corpus and a short search over every target.

use rivet_fuzz::{Mutator, TARGETS, search, seeds};
use std::time::Duration;

#[test]
fn nothing_breaks_in_a_second_of_every_target() {
    for target in &TARGETS {
        let seeds = seeds(target).expect("a corpus");
        assert!(!seeds.is_empty(), "{}: no seeds", target.name);
        let found = search(target, seeds, Duration::from_secs(1), 7);
        assert!(found.broken.is_none(), "{}: {found:?}", target.name);
        // The seeds reach more than one thing, and the search goes on from there.
        assert!(found.inputs > 10 && found.signatures > 1, "{}: {found:?}", target.name);
    }
}

#[test]
fn the_same_seed_makes_the_same_inputs() {
    let corpus = [b"abcdefgh".to_vec(), vec![0; 40]];
    let [mut a, mut b] = [7, 7].map(|seed| Mutator::new(seed, &["word"]));
    for _ in 0..1000 {
        assert_eq!(a.change(&corpus), b.change(&corpus));
    }
}
