//! One publisher of a topic is used; what another one sends meanwhile is left out and counted.

/// Silence of a publisher after which another one takes its place \[ns\].
const SUCCESSION_NS: u64 = 500_000_000;
/// Publishers that are named.
const NAMED: usize = 8;

/// A publisher: its GUID on DDS.
pub type Guid = [u8; 16];

/// What is to be done with a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Admission {
    /// It is from the publisher that is used.
    Used,
    /// It is from another one, which is used from now on.
    Succession,
    /// It is from another one and left out.
    Foreign,
}

/// The publisher that is used, and the others.
#[derive(Clone, Debug, Default)]
pub struct Source {
    current: Option<Guid>,
    /// The one that was used last, also when it has left.
    last: Option<Guid>,
    last_message_ns: u64,
    foreign: u64,
    others: Vec<Guid>,
}

impl Source {
    /// Decides about a message of `from` that came at `now_ns` \[ns\].
    pub fn admit(&mut self, from: Guid, now_ns: u64) -> Admission {
        let admission = match self.current {
            Some(current) if current == from => Admission::Used,
            // The link was cut for longer than DDS waits.
            None if self.last == Some(from) => Admission::Used,
            Some(_) if now_ns.saturating_sub(self.last_message_ns) <= SUCCESSION_NS => {
                self.foreign += 1;
                if self.others.len() < NAMED && !self.others.contains(&from) {
                    self.others.push(from);
                }
                return Admission::Foreign;
            }
            _ => Admission::Succession,
        };
        (self.current, self.last) = (Some(from), Some(from));
        self.others.retain(|other| *other != from);
        self.last_message_ns = now_ns;
        admission
    }

    /// A publisher has left.
    pub fn publisher_left(&mut self, guid: Guid) {
        if self.current == Some(guid) {
            self.current = None;
        }
        self.others.retain(|other| *other != guid);
    }

    /// The publisher that is used.
    pub fn current(&self) -> Option<Guid> {
        self.current
    }

    /// The other publishers that were met and have not left, at most eight.
    pub fn others(&self) -> &[Guid] {
        &self.others
    }

    /// Messages that were left out.
    pub fn foreign(&self) -> u64 {
        self.foreign
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keeps_to_the_first_publisher_until_it_is_silent_or_has_left() {
        let (a, b) = ([1; 16], [2; 16]);
        let mut source = Source::default();
        assert_eq!(source.admit(a, 0), Admission::Succession);
        assert_eq!(source.admit(a, 1_000_000), Admission::Used);
        assert_eq!(source.admit(b, 2_000_000), Admission::Foreign);
        assert_eq!((source.foreign(), source.others()), (1, &[b][..]));
        assert_eq!(source.admit(b, 600_000_000), Admission::Succession, "the first one is silent");
        assert_eq!(source.others(), &[] as &[Guid]);
        assert_eq!(source.admit(a, 601_000_000), Admission::Foreign);
        source.publisher_left(b);
        assert_eq!(source.admit(a, 602_000_000), Admission::Succession);
        source.publisher_left(a);
        assert_eq!(source.admit(a, 99_000_000_000), Admission::Used, "the same one, after a cut");
    }
}
