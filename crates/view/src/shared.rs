//! What the threads of the server share: subscriptions, messages that wait, counts.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::channel::Channel;
use crate::protocol::Subscription;

/// Messages that wait for a client at most; the oldest makes room for the newest.
const MAX_WAITING: usize = 1024;
/// Subscriptions of a client.
const MAX_SUBSCRIPTIONS: usize = 1024;

/// A message on its way to a subscription.
#[derive(Clone, Debug)]
pub(crate) struct Outgoing {
    /// Id of the subscription.
    pub(crate) id: u32,
    pub(crate) channel: usize,
    /// Time of the log \[ns since 1970\].
    pub(crate) log_time_ns: u64,
    pub(crate) payload: Arc<[u8]>,
}

/// Time of the log \[ns since 1970\] and payload of a message that is kept.
type Kept = (u64, Arc<[u8]>);

/// What a client subscribed to, and what waits for it.
#[derive(Debug, Default)]
pub(crate) struct Mailbox {
    subscriptions: Vec<Subscription>,
    waiting: VecDeque<Outgoing>,
}

impl Mailbox {
    /// Ids of the subscriptions to a channel.
    fn ids(&self, channel: usize) -> impl Iterator<Item = u32> {
        let of_channel = move |s: &&Subscription| usize::try_from(s.channel).is_ok_and(|c| c == channel);
        self.subscriptions.iter().filter(of_channel).map(|s| s.id)
    }

    /// Adds a message; the channel of the one that made room for it.
    fn push(&mut self, outgoing: Outgoing) -> Option<usize> {
        let oldest = if self.waiting.len() >= MAX_WAITING { self.waiting.pop_front() } else { None };
        self.waiting.push_back(outgoing);
        oldest.map(|oldest| oldest.channel)
    }

    /// The oldest message that waits.
    pub(crate) fn pop(&mut self) -> Option<Outgoing> {
        self.waiting.pop_front()
    }
}

/// Counts of one channel.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    /// Messages that went to a client, each client by itself.
    pub(crate) sent: AtomicU64,
    /// Messages that gave way to newer ones, since the client was too slow.
    pub(crate) dropped: AtomicU64,
}

/// What threads share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) name: String,
    pub(crate) session: String,
    pub(crate) channels: Vec<Channel>,
    pub(crate) tallies: Vec<Tally>,
    /// The last message of each channel that keeps it.
    kept: Mutex<Vec<Option<Kept>>>,
    clients: Mutex<Vec<Arc<Mutex<Mailbox>>>>,
    pub(crate) connected: AtomicUsize,
    pub(crate) ever: AtomicU64,
    pub(crate) refused: AtomicU64,
    pub(crate) stop: AtomicBool,
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    pub(crate) fn new(name: &str, session: &str, channels: Vec<Channel>) -> Shared {
        Shared {
            name: name.to_owned(),
            session: session.to_owned(),
            tallies: channels.iter().map(|_| Tally::default()).collect(),
            kept: Mutex::new(vec![None; channels.len()]),
            channels,
            clients: Mutex::default(),
            connected: AtomicUsize::new(0),
            ever: AtomicU64::new(0),
            refused: AtomicU64::new(0),
            stop: AtomicBool::new(false),
        }
    }

    /// Adds subscriptions of a client; what to answer for each that cannot be.
    pub(crate) fn subscribe(&self, mailbox: &Mutex<Mailbox>, wanted: &[Subscription]) -> Vec<String> {
        let mut answers = Vec::new();
        // In the order of `publish`, so that no message is between the kept one and the next.
        let kept = lock(&self.kept);
        let mut mailbox = lock(mailbox);
        for subscription in wanted {
            let channel = usize::try_from(subscription.channel).ok().filter(|channel| *channel < self.channels.len());
            let Some(channel) = channel else {
                answers.push(format!("there is no channel {}", subscription.channel));
                continue;
            };
            if mailbox.subscriptions.iter().any(|s| s.id == subscription.id) {
                answers.push(format!("subscription {} is there already", subscription.id));
                continue;
            }
            if mailbox.subscriptions.len() >= MAX_SUBSCRIPTIONS {
                answers.push(format!("there are {MAX_SUBSCRIPTIONS} subscriptions already"));
                break;
            }
            mailbox.subscriptions.push(*subscription);
            if let Some((log_time_ns, payload)) = &kept[channel] {
                let (id, payload) = (subscription.id, Arc::clone(payload));
                self.count_dropped(mailbox.push(Outgoing { id, channel, log_time_ns: *log_time_ns, payload }));
            }
        }
        answers
    }

    /// Removes subscriptions of a client; what to answer for each that is not there.
    pub(crate) fn unsubscribe(mailbox: &Mutex<Mailbox>, ids: &[u32]) -> Vec<String> {
        let mut mailbox = lock(mailbox);
        let mut answers = Vec::new();
        for id in ids {
            let before = mailbox.subscriptions.len();
            mailbox.subscriptions.retain(|s| s.id != *id);
            if mailbox.subscriptions.len() == before {
                answers.push(format!("there is no subscription {id}"));
                // As many as a client may have are enough to answer.
                if answers.len() >= MAX_SUBSCRIPTIONS {
                    break;
                }
            }
        }
        let Mailbox { subscriptions, waiting } = &mut *mailbox;
        waiting.retain(|outgoing| subscriptions.iter().any(|s| s.id == outgoing.id));
        answers
    }

    /// Whether a message of a channel goes anywhere: a client has subscribed, or the last message is kept.
    pub(crate) fn wants(&self, channel: usize) -> bool {
        self.channels[channel].is_kept
            || lock(&self.clients).iter().any(|mailbox| lock(mailbox).ids(channel).next().is_some())
    }

    /// Passes a message to all clients that subscribed to its channel. Never waits for one.
    pub(crate) fn publish(&self, channel: usize, log_time_ns: u64, payload: &[u8]) {
        let payload: Arc<[u8]> = payload.into();
        let mut kept = lock(&self.kept);
        if self.channels[channel].is_kept {
            kept[channel] = Some((log_time_ns, Arc::clone(&payload)));
        }
        for mailbox in lock(&self.clients).iter() {
            let mut mailbox = lock(mailbox);
            let ids: Vec<u32> = mailbox.ids(channel).collect();
            for id in ids {
                let payload = Arc::clone(&payload);
                self.count_dropped(mailbox.push(Outgoing { id, channel, log_time_ns, payload }));
            }
        }
    }

    /// Counts a message of a channel that gave way to a newer one.
    fn count_dropped(&self, channel: Option<usize>) {
        if let Some(channel) = channel {
            self.tallies[channel].dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    pub(crate) fn join(&self, mailbox: &Arc<Mutex<Mailbox>>) {
        lock(&self.clients).push(Arc::clone(mailbox));
    }

    pub(crate) fn leave(&self, mailbox: &Arc<Mutex<Mailbox>>) {
        lock(&self.clients).retain(|other| !Arc::ptr_eq(other, mailbox));
    }
}
