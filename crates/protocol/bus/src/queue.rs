//! A bounded queue between a callback, which must not wait, and one async reader: full means the newest is dropped.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::Notify;

struct Inner<T> {
    entries: Mutex<Entries<T>>,
    arrived: Notify,
}

struct Entries<T> {
    queue: VecDeque<(usize, T)>,
    lengths: Vec<usize>,
}

/// Entries of several lanes in order of arrival; each lane has a limit of its own.
pub(crate) struct Queue<T> {
    inner: Arc<Inner<T>>,
    most: usize,
}

impl<T> Clone for Queue<T> {
    fn clone(&self) -> Self {
        Self { inner: Arc::clone(&self.inner), most: self.most }
    }
}

impl<T> Queue<T> {
    /// Makes a queue of so many lanes that hold so many entries each.
    pub(crate) fn new(lanes: usize, most: usize) -> Self {
        let entries = Mutex::new(Entries { queue: VecDeque::new(), lengths: vec![0; lanes] });
        Self { inner: Arc::new(Inner { entries, arrived: Notify::new() }), most }
    }

    /// Adds an entry, or returns false where the lane is full.
    pub(crate) fn offer(&self, lane: usize, entry: T) -> bool {
        {
            let mut entries = self.inner.entries.lock().unwrap_or_else(PoisonError::into_inner);
            if entries.lengths[lane] >= self.most {
                return false;
            }
            entries.lengths[lane] += 1;
            entries.queue.push_back((lane, entry));
        }
        self.inner.arrived.notify_one();
        true
    }

    /// Takes the oldest entry, if there is one.
    pub(crate) fn take(&self) -> Option<T> {
        let mut entries = self.inner.entries.lock().unwrap_or_else(PoisonError::into_inner);
        let (lane, entry) = entries.queue.pop_front()?;
        entries.lengths[lane] -= 1;
        Some(entry)
    }

    /// Waits for the oldest entry. Safe to cancel.
    pub(crate) async fn wait(&self) -> T {
        loop {
            if let Some(entry) = self.take() {
                return entry;
            }
            self.inner.arrived.notified().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_lane_refuses_the_newest_and_leaves_the_others_alone() {
        let queue = Queue::new(2, 2);
        let taken: Vec<bool> = [(0, 1), (0, 2), (0, 3), (1, 4)].map(|(lane, entry)| queue.offer(lane, entry)).into();
        assert_eq!(taken, [true, true, false, true]);
        assert_eq!([queue.take(), queue.take(), queue.take(), queue.take()], [Some(1), Some(2), Some(4), None]);
        assert!(queue.offer(0, 5));
    }
}
