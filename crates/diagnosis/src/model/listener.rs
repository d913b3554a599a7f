//! What a diagnosis reports while it works.

/// Takes the steps and decisions of a diagnosis as they come.
pub trait Listener {
    /// A line of text: a step that begins, a candidate with its evidence, a decision.
    fn line(&mut self, text: &str);

    /// `done` of the `total` candidates of the present round have their columns. Comes after each candidate of the calling thread.
    fn count(&mut self, done: usize, total: usize);
}

/// A listener that drops everything.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Listener for Silent {
    fn line(&mut self, _: &str) {}

    fn count(&mut self, _: usize, _: usize) {}
}
