//! The gap over time and place on one drive: residuals of the nominal and of the corrected simulator, for pictures.
//!
//! A rollout starts every quarter of a second from the measured state and lasts 2 s (followers: the windows of the fit,
//! 5 s). Position is the error after 2 s, a channel the root mean square over the rollout, each at the rollout's start
//! and in the channel's unit, beside the noise floor of the same blocks. Nothing is fitted.

use ds_effect::{Channel, Plant};

use crate::case::Case;
use crate::evaluate;
use crate::floor;
use crate::following;
use crate::noise::Noise;
use crate::space::{Part, Space};
use crate::windows::{BLOCK, BLOCKS, EGO, EgoRecord};
use ds_diagnosis::schema::Corrected;
use ds_diagnosis::table::STEP_SECS;

/// Name of the series of position errors after 2 s.
pub const POSITION: &str = "position_2s";
/// Samples between starts of rollouts.
const STRIDE: usize = 5;
/// Most rollouts of a drive; longer drives get a longer stride.
const MOST: usize = 600;

/// The gap along one drive.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Traces {
    /// Index of the drive in the case.
    pub drive: usize,
    /// Name of its file.
    pub file: String,
    /// Whether the drive was kept from the fit.
    pub held_out: bool,
    /// Time in s and position in m, in order; empty where no position was recorded.
    pub path: Vec<[f64; 3]>,
    /// Position first, then every channel that was recorded.
    pub series: Vec<Series>,
}

/// One error over time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    /// [`POSITION`] or the channel's name.
    pub name: String,
    /// In order of time.
    pub moments: Vec<Moment>,
}

/// The error of the rollout that starts at one instant, in the unit of its series.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Moment {
    /// Stamp of the start, s.
    pub secs: f64,
    /// Error of the nominal simulator.
    pub before: f64,
    /// Error of the corrected simulator.
    pub after: f64,
    /// What an effect-free world leaves.
    pub floor: f64,
}

impl Series {
    /// Returns the root mean squares over time: before, after, floor.
    #[must_use]
    pub fn roots(&self) -> [f64; 3] {
        let count = self.moments.len().max(1) as f64;
        let root = |f: fn(&Moment) -> f64| (self.moments.iter().map(|m| f(m).powi(2)).sum::<f64>() / count).sqrt();
        [root(|m| m.before), root(|m| m.after), root(|m| m.floor)]
    }
}

/// Returns the gap along a drive of a case under a corrected model; empty where the case has no such drive.
#[must_use]
pub fn traces(case: &Case, model: &Corrected, drive: usize) -> Traces {
    let Some(log) = case.drives.get(drive) else { return Traces::default() };
    let mut out = Traces { drive, file: log.file.clone(), ..Traces::default() };
    out.held_out = case.meta.split().1.contains(&drive);
    let stride = STRIDE.max(log.samples / MOST);
    if let (Some(x), Some(y)) = (&log.x, &log.y) {
        let at = |k: usize| [log.start_secs + k as f64 * STEP_SECS, x[k], y[k]];
        out.path = (0..log.samples).step_by(stride).map(at).filter(|p| p.iter().all(|v| v.is_finite())).collect();
    }
    let [ego, followers] = [Part::Ego, Part::Following].map(|part| plants(case, model, part));
    for record in case.ego.iter().filter(|record| record.drive == drive) {
        out.series.extend(ego_series(record, &ego, stride, &case.noise));
    }
    out.series.extend(follower_series(case, &followers, drive));
    out
}

/// Returns the nominal and the corrected simulator of a part; what the model does not name is neutral.
fn plants(case: &Case, model: &Corrected, part: Part) -> [Plant; 2] {
    let space = Space::new(part, &case.meta.nominal, &[]);
    let [nominal, _, corrected] = evaluate::plants(&space, model, case.meta.nominal.mass);
    [nominal, corrected]
}

fn ego_series(record: &EgoRecord, plants: &[Plant; 2], stride: usize, noise: &Noise) -> Vec<Series> {
    let anchors = record.anchors_every(stride, BLOCK * BLOCKS);
    let [before, after] = plants.each_ref().map(|plant| record.windows(&anchors, &record.inputs, plant));
    let series = |name: &str, error: &dyn Fn(&[f64]) -> f64, clean: &dyn Fn(usize) -> f64| {
        let moment = |k: usize| Moment {
            secs: anchors[k].secs,
            before: error(&before[k]),
            after: error(&after[k]),
            floor: clean(k),
        };
        Series { name: name.to_owned(), moments: (0..anchors.len()).map(moment).filter(finite).collect() }
    };
    let floor = |k: usize, channel, block| floor::ego(channel, block, &anchors[k].regime, noise);
    let last = BLOCKS - 1;
    let mut all =
        vec![series(POSITION, &|r| r[last].hypot(r[BLOCKS + last]), &|k| floor(k, 0, last).hypot(floor(k, 1, last)))];
    for channel in 0..EGO {
        let error = |r: &[f64]| root(&r[channel * BLOCKS..(channel + 1) * BLOCKS]);
        let clean = |k: usize| root(&(0..BLOCKS).map(|block| floor(k, channel, block)).collect::<Vec<_>>());
        all.push(series(Channel::ALL[channel].name(), &error, &clean));
    }
    all.retain(|series| !series.moments.is_empty());
    all
}

/// Followers that start at the same instant share a moment: their root mean square.
fn follower_series(case: &Case, plants: &[Plant; 2], drive: usize) -> Vec<Series> {
    let blocks = following::BLOCKS;
    let records: Vec<_> = case.following.iter().filter(|record| record.drive == drive).collect();
    let mut all = Vec::new();
    for (place, channel) in [Channel::FollowerSpeed, Channel::FollowerGap].into_iter().enumerate() {
        let clean = root(&(0..blocks).map(|block| floor::follower(place, block, &case.noise)).collect::<Vec<_>>());
        let mut moments: Vec<(Moment, f64)> = Vec::new();
        for record in &records {
            let [before, after] = plants.each_ref().map(|plant| record.residuals(plant));
            for (k, &start) in record.starts.iter().enumerate() {
                let own = (2 * k + place) * blocks..(2 * k + place + 1) * blocks;
                let [before, after] = [&before, &after].map(|r| root(&r[own.clone()]).powi(2));
                let secs = record.secs(start);
                match moments.iter_mut().find(|(m, _)| (m.secs - secs).abs() < 1e-3) {
                    Some((m, count)) => {
                        (m.before, m.after, *count) = (m.before + before, m.after + after, *count + 1.0)
                    }
                    None => moments.push((Moment { secs, before, after, floor: clean }, 1.0)),
                }
            }
        }
        let mean = |(m, count): &(Moment, f64)| Moment {
            before: (m.before / count).sqrt(),
            after: (m.after / count).sqrt(),
            ..*m
        };
        let mut moments: Vec<Moment> = moments.iter().map(mean).filter(finite).collect();
        moments.sort_by(|a, b| a.secs.total_cmp(&b.secs));
        if !moments.is_empty() {
            all.push(Series { name: channel.name().to_owned(), moments });
        }
    }
    all
}

fn root(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

fn finite(moment: &Moment) -> bool {
    [moment.secs, moment.before, moment.after, moment.floor].iter().all(|v| v.is_finite())
}
