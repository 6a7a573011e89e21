//! The last seconds of a drive, and when they are to be diagnosed.

use std::collections::VecDeque;

use ds_topic::Header;
use ds_world::Reading;

/// Shorter windows tell nothing.
pub const SHORTEST_SECS: f64 = 6.5;
/// Less than this is not worth another look when a drive has ended.
const LAST_SECS: f64 = 0.5;

/// A sliding window.
pub struct Window {
    readings: VecDeque<Reading>,
    /// Headers of the states that the readings came with.
    headers: VecDeque<Header>,
    secs: f64,
    every_secs: f64,
    next_secs: f64,
}

/// A window that is to be diagnosed.
#[derive(Debug, Clone)]
pub struct Due {
    /// What the car recorded.
    pub readings: Vec<Reading>,
    /// Header of the state at its end.
    pub header: Header,
    /// Its first and last moment, s.
    pub span: (f64, f64),
}

impl Window {
    /// Makes an empty window of some length, to be looked at every so often.
    #[must_use]
    pub fn new(secs: f64, every_secs: f64) -> Self {
        Self { readings: VecDeque::new(), headers: VecDeque::new(), secs, every_secs, next_secs: SHORTEST_SECS }
    }

    /// Takes what was recorded up to a state; another attempt at the episode begins anew.
    pub fn take(&mut self, header: Header, readings: Vec<Reading>) {
        if self.headers.back().is_some_and(|last| last.attempt != header.attempt) {
            *self = Self::new(self.secs, self.every_secs);
        }
        // Stamps are the receiver's: with jitter one may lie before the last.
        let mut newest = self.readings.back().map_or(f64::NEG_INFINITY, |reading| reading.secs);
        for reading in readings {
            if reading.secs > newest {
                newest = reading.secs;
                self.readings.push_back(reading);
            }
        }
        self.headers.push_back(header);
        while self.readings.front().is_some_and(|first| newest - first.secs > self.secs) {
            self.readings.pop_front();
        }
        while self.headers.front().is_some_and(|first| newest - first.time.secs() > self.secs) {
            self.headers.pop_front();
        }
    }

    /// Returns the window where a diagnosis is due. It ends at `known_to_secs` at the latest; when the drive is over, what
    /// has not been looked at yet is due at once.
    pub fn due(&mut self, known_to_secs: f64, over: bool) -> Option<Due> {
        let first = self.readings.front()?.secs;
        let readings: Vec<Reading> = self.readings.iter().take_while(|r| r.secs <= known_to_secs).copied().collect();
        let last = readings.last()?.secs;
        let looked_at = self.next_secs - self.every_secs;
        let soon = over && last > looked_at + LAST_SECS;
        if (last < self.next_secs && !soon) || last - first < SHORTEST_SECS - 0.5 {
            return None;
        }
        self.next_secs = last + self.every_secs;
        let at = self.headers.iter().position(|header| header.time.secs() > last - 1e-6);
        let header = at.map_or_else(|| self.headers.back(), |at| self.headers.get(at))?.clone();
        Some(Due { readings, header, span: (first, last) })
    }
}

#[cfg(test)]
mod tests {
    use ds_space::{AttemptId, Digest, EpisodeId, InstanceId, SimTime, Tick};
    use ds_topic::{SCHEMA_VERSION, Slot, Topic};

    use super::*;

    fn header(attempt: u32, tick: u32) -> Header {
        Header {
            episode: EpisodeId::new("e").expect("an id"),
            attempt: AttemptId(attempt),
            term: 1,
            epoch: 1,
            iteration: tick / 5,
            tick: Tick(tick),
            time: SimTime::at(Tick(tick), SimTime::from_secs(0.1)),
            sequence: 0,
            publisher: InstanceId::new("sim-0").expect("an id"),
            schema_version: SCHEMA_VERSION,
            trace: String::new(),
            slot: Slot::new(Topic::World, tick),
            content: Digest::default(),
        }
    }

    fn reading(tick: u32) -> Vec<Reading> {
        vec![Reading { secs: f64::from(tick) * 0.1, ..Reading::default() }]
    }

    #[test]
    fn the_window_slides_and_ends_with_the_drive() {
        let mut window = Window::new(8.0, 2.0);
        let mut due = Vec::new();
        for tick in 0..200 {
            window.take(header(1, tick), reading(tick));
            due.extend(window.due(f64::INFINITY, false));
        }
        assert!(due.len() >= 6 && due.windows(2).all(|pair| pair[1].span.1 >= pair[0].span.1 + 1.99), "{}", due.len());
        assert!(due.iter().all(|due| due.readings.len() <= 82 && due.span.1 - due.span.0 >= 6.0));
        assert!(due.iter().all(|due| (due.header.time.secs() - due.span.1).abs() < 0.06));
        let last = due.last().expect("some").span.1;
        let rest = window.due(f64::INFINITY, true);
        assert_eq!(rest.is_some(), 19.9 > last + LAST_SECS);
        assert!(window.due(f64::INFINITY, true).is_none(), "the same is due twice");
    }

    #[test]
    fn a_reference_that_lags_holds_the_window_back() {
        let mut window = Window::new(8.0, 2.0);
        (0..120).for_each(|tick| window.take(header(1, tick), reading(tick)));
        assert!(window.due(5.0, false).is_none());
        let due = window.due(10.0, false).expect("long enough");
        assert!((due.span.1 - 10.0).abs() < 1e-9 && due.header.tick == Tick(100), "{:?}", due.span);
    }

    #[test]
    fn another_attempt_begins_anew() {
        let mut window = Window::new(8.0, 2.0);
        (0..80).for_each(|tick| window.take(header(1, tick), reading(tick)));
        window.take(header(2, 0), reading(0));
        assert!(window.due(f64::INFINITY, true).is_none());
    }
}
