//! Scores of windows → alarms, so many false ones an hour: e-detectors (Shin, Ramdas, Rinaldo 2022), one a channel, averaged.
//!
//! p = (1 + windows of healthy logs that left as much) / (1 + all of them), their scores raised by how far a further healthy
//! log may lie above the others, for what its day brings is common to all its windows; e = mean of κ p^(κ-1), whose mean is at most one
//! where the window is as those of healthy logs. What is hard to drive lasts longer than a window: e of two neighbours is
//! averaged, which holds however they depend, and M = (1 + M) e runs over every second window, once for either phase. Alarm
//! where the mean of M over channels and phases reaches the windows an hour over the alarms an hour.

use super::scores::WINDOW_SECS;
use crate::baseline::windows::{Scored, Windows};
use crate::windows::EGO;
use ds_diagnosis::CaseError;
use ds_effect::Channel;

/// Exponents of the calibrator.
const KAPPAS: [f64; 4] = [0.1, 0.3, 0.5, 0.7];
/// Windows whose evidence is averaged.
const PHASES: usize = 2;
/// Logs from which on windows of a further log can be judged.
const LEAST_LOGS: usize = 3;
/// Spread of the mean scores of healthy logs of one vehicle, and the degrees of freedom with which it is known beforehand: what
/// 90 healthy logs of three vehicles had (own world, seed 7456).
const SPREAD: f64 = 0.15;
/// See [`SPREAD`].
const FREEDOM: f64 = 4.0;
/// Spreads by which a further log may lie above the others; on that seed 1 let two false alarms through in 3.3 h, 1.5 none.
const ABOVE: f64 = 1.5;
/// Share of the evidence from which a channel is named.
const NAMED: f64 = 0.1;

/// Windows of an hour over those that are judged together.
pub const STEPS_AN_HOUR: f64 = 3600.0 / (WINDOW_SECS * PHASES as f64);

/// Evidence that something began.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// Channels with their shares of it, largest first.
    pub channels: Vec<(Channel, f64)>,
    /// Windows since what the first of them tells began.
    pub windows: usize,
}

/// The evidence of one channel.
#[derive(Debug, Clone, Default)]
struct Stream {
    /// What healthy logs leave, in order.
    healthy: Vec<f64>,
    detectors: [f64; PHASES],
    last: Option<f64>,
    /// Evidence of the windows since some moment, and how many these are.
    run: (f64, usize),
}

/// Judges windows one after another.
#[derive(Debug, Clone)]
pub struct Detector {
    streams: Vec<Stream>,
    threshold: f64,
    taken: usize,
}

impl Detector {
    /// Begins with what healthy logs leave and the false alarms allowed an hour.
    ///
    /// # Errors
    /// If there are too few healthy logs.
    pub fn new(windows: Option<&Windows>, alarms_per_hour: f64) -> Result<Self, CaseError> {
        let logs = windows.map_or(&[][..], |windows| &windows.logs);
        let telling = logs.iter().filter(|log| !log.is_empty()).count();
        if telling < LEAST_LOGS {
            return Err(CaseError::Unwatched { logs: telling, least: LEAST_LOGS });
        }
        let of = |channel: usize| {
            let score = |window: &Scored| window.channels.get(channel).copied().flatten().map(|[loss, _]| loss);
            let scored: Vec<Vec<f64>> = logs.iter().map(|log| log.iter().filter_map(score).collect()).collect();
            let above = above(&scored);
            let mut healthy: Vec<f64> = scored.concat().into_iter().map(|loss| loss + above).collect();
            healthy.sort_by(f64::total_cmp);
            Stream { healthy, ..Stream::default() }
        };
        Ok(Self { streams: (0..EGO).map(of).collect(), threshold: STEPS_AN_HOUR / alarms_per_hour, taken: 0 })
    }

    /// Returns the evidence at which there is an alarm.
    #[must_use]
    pub fn threshold(&self) -> f64 {
        self.threshold
    }

    /// Takes a window; after an alarm all begins anew.
    pub fn take(&mut self, window: &Scored) -> Option<Evidence> {
        let phase = self.taken % PHASES;
        self.taken += 1;
        for (stream, score) in self.streams.iter_mut().zip(&window.channels) {
            stream.take(score.map(|[loss, _]| loss), phase);
        }
        let known: Vec<&Stream> = self.streams.iter().filter(|stream| !stream.healthy.is_empty()).collect();
        let sum: f64 = known.iter().map(|stream| stream.sum()).sum();
        if sum < self.threshold * (known.len() * PHASES) as f64 {
            return None;
        }
        let share = |(k, stream): (usize, &Stream)| (Channel::ALL[k], stream.sum() / sum);
        let mut channels: Vec<(Channel, f64)> = self.streams.iter().enumerate().map(share).collect();
        channels.retain(|(_, share)| *share >= NAMED);
        channels.sort_by(|a, b| b.1.total_cmp(&a.1));
        let windows = channels.first().map_or(0, |(channel, _)| self.streams[channel.index()].run.1);
        self.streams.iter_mut().for_each(Stream::forget);
        Some(Evidence { channels, windows })
    }
}

/// Returns how far the scores of a further healthy log may lie above those of some.
fn above(logs: &[Vec<f64>]) -> f64 {
    let means: Vec<f64> = logs.iter().filter_map(|log| ds_stats::mean(log.iter().copied())).collect();
    let count = means.len() as f64;
    let Some(centre) = ds_stats::mean(means.iter().copied()) else { return 0.0 };
    let squares: f64 = means.iter().map(|mean| (mean - centre).powi(2)).sum();
    let variance = (FREEDOM * SPREAD * SPREAD + squares) / (FREEDOM + count - 1.0);
    ABOVE * (variance * (1.0 + 1.0 / count)).sqrt()
}

impl Stream {
    fn sum(&self) -> f64 {
        self.detectors.iter().sum()
    }

    fn forget(&mut self) {
        *self = Self { healthy: std::mem::take(&mut self.healthy), ..Self::default() };
    }

    fn take(&mut self, score: Option<f64>, phase: usize) {
        let Some(score) = score.filter(|_| !self.healthy.is_empty()) else {
            self.last = None;
            return;
        };
        let e = self.evidence(score);
        self.run = if self.run.0 > 1.0 { (self.run.0 * e, self.run.1 + 1) } else { (e, 1) };
        let mean = 0.5 * (e + self.last.unwrap_or(e));
        self.last = Some(e);
        self.detectors[phase] = (1.0 + self.detectors[phase]) * mean;
    }

    /// Returns what a window says against being healthy.
    fn evidence(&self, score: f64) -> f64 {
        let below = self.healthy.partition_point(|left| *left < score);
        let p = (1.0 + (self.healthy.len() - below) as f64) / (1.0 + self.healthy.len() as f64);
        KAPPAS.iter().map(|kappa| kappa * p.powf(kappa - 1.0)).sum::<f64>() / KAPPAS.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use ds_space::Draws;

    use super::*;

    fn window(score: impl Fn(usize) -> f64) -> Scored {
        Scored { drive: 0, secs: 0.0, channels: (0..EGO).map(|c| Some([score(c), 0.0])).collect() }
    }

    fn healthy(logs: u64, windows: u64) -> Windows {
        let log = |log: u64| {
            let draws = Draws::from_seed(log, "healthy windows");
            (0..windows).map(|k| window(|c| draws.normal(k * EGO as u64 + c as u64))).collect()
        };
        Windows { logs: (0..logs).map(log).collect(), ..Windows::default() }
    }

    fn alarms(detector: &mut Detector, windows: u64, shift: f64) -> Vec<u64> {
        let draws = Draws::from_seed(99, "watched windows");
        let score = |k: u64, c: usize| draws.normal(k * EGO as u64 + c as u64) + if c == 4 { shift } else { 0.0 };
        (0..windows).filter(|k| detector.take(&window(|c| score(*k, c))).is_some()).collect()
    }

    #[test]
    fn healthy_windows_alarm_no_oftener_than_allowed_and_a_step_does_soon() {
        for rate in [1.0, 20.0] {
            let mut detector = Detector::new(Some(&healthy(4, 70)), rate).expect("four logs");
            let hours = 20.0;
            let found = alarms(&mut detector, (1800.0 * hours) as u64, 0.0).len() as f64;
            assert!(found <= 1.5 * rate * hours, "{found} alarms, {} allowed", rate * hours);
        }
        let mut detector = Detector::new(Some(&healthy(4, 70)), 1.0).expect("four logs");
        let first = alarms(&mut detector, 40, 4.0)[0];
        assert!(first <= 10, "after {first} windows");
    }

    #[test]
    fn an_alarm_names_the_channel_and_when_it_began() {
        let mut detector = Detector::new(Some(&healthy(4, 70)), 1.0).expect("four logs");
        let shifted = |k: u64, c: usize| if c == 4 && k >= 20 { 6.0 } else { -0.5 };
        let found = (0..60).find_map(|k| Some((k, detector.take(&window(|c| shifted(k, c)))?)));
        let (at, evidence) = found.expect("an alarm");
        assert_eq!(evidence.channels[0].0, Channel::YawRate, "{evidence:?}");
        assert_eq!(at + 1 - evidence.windows as u64, 20, "{evidence:?}");
    }

    #[test]
    fn few_logs_are_refused() {
        assert!(Detector::new(Some(&healthy(2, 70)), 1.0).is_err());
        let refused = Detector::new(None, 1.0).expect_err("no windows at all").to_string();
        assert!(refused.contains("gap baseline"), "{refused}");
    }
}
