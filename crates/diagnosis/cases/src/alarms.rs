//! A drive that goes on, watched against a baseline: readings as they come → windows, one after another → alarms.
//!
//! The windows are those of a recorded log of the same drive, and the detector is the same. Only the last seconds are kept.

use std::sync::Arc;

use ds_diagnosis::CaseError;
use ds_diagnosis::meta::VehicleMeta;
use ds_dynamics::baseline::Baseline;
use ds_dynamics::watch::scores::{Scorer, WINDOW_SECS};
use ds_dynamics::watch::{Alarm, Watch, since};
use ds_world::Reading;

use crate::logs;

/// Least that is kept, s: shorter logs are none.
const KEPT_SECS: f64 = 10.0;
/// Readings from which on a window can be judged, s.
const LEAST_SECS: f64 = 6.5;
/// Before the first window the simulator warms up, s.
const LEAD_SECS: f64 = 0.5;
/// How much must be known beyond the end of a window, s.
const BEYOND_SECS: f64 = 0.045;
/// Difference below which stamps are equal, s.
const SAME_SECS: f64 = 0.01;

/// A watch over one drive.
pub struct Alarms {
    /// The detector.
    pub watch: Watch,
    baseline: Arc<Baseline>,
    scorer: Scorer,
    meta: VehicleMeta,
    name: String,
    readings: Vec<Reading>,
    /// Stamp of the drive's first reading, if there is one, and where the next window begins.
    places: Option<(f64, f64)>,
}

impl Alarms {
    /// Begins to watch a drive of a car.
    ///
    /// # Errors
    /// If the baseline has no windows of three healthy logs or more.
    pub fn new(baseline: Arc<Baseline>, alarms_per_hour: f64, meta: VehicleMeta) -> Result<Self, CaseError> {
        let watch = Watch::new(baseline.clone(), alarms_per_hour)?;
        let (scorer, name) = (watch.scorer(), meta.case.clone());
        Ok(Self { watch, baseline, scorer, meta, name, readings: Vec::new(), places: None })
    }

    /// Turns to a drive of another description, by the same detector.
    pub fn turn_to(&mut self, meta: VehicleMeta) {
        self.name.clone_from(&meta.case);
        self.meta = meta;
        self.restart();
    }

    /// Begins the drive anew: what its day brings is unknown again.
    pub fn restart(&mut self) {
        self.scorer = self.watch.scorer();
        self.readings.clear();
        self.places = None;
    }

    /// Takes what was recorded; stamps that go back are left out.
    ///
    /// # Errors
    /// If the readings make no sense, or the baseline is not one for the car.
    pub fn take(&mut self, readings: &[Reading]) -> Result<Vec<Alarm>, CaseError> {
        for reading in readings {
            if self.readings.last().is_none_or(|last| reading.secs > last.secs) {
                self.readings.push(*reading);
            }
        }
        let (Some(kept), Some(last)) = (self.readings.first(), self.readings.last()) else { return Ok(Vec::new()) };
        let (first, mut next) = *self.places.get_or_insert((kept.secs, kept.secs + LEAD_SECS));
        let (span, now) = (last.secs - kept.secs, last.secs);
        if span < LEAST_SECS || now < next + WINDOW_SECS + BEYOND_SECS {
            return Ok(Vec::new());
        }
        let case = logs::case_of(&self.readings, self.meta.clone())?;
        self.baseline.check(&case.meta, &case.drives, case.stand_in.as_ref())?;
        let (scored, strange) = self.scorer.take(&case, &[0], next - SAME_SECS);
        self.watch.strange += strange;
        let mut found = Vec::new();
        for window in scored {
            let Some(evidence) = self.watch.take(&window) else { continue };
            found.push(Alarm {
                case: self.name.clone(),
                drive: 0,
                file: self.name.clone(),
                secs: window.secs,
                since_secs: since(&evidence, window.secs).max(first),
                hours: self.watch.hours(),
                channels: evidence.channels.iter().map(|(c, share)| (c.name().to_owned(), *share)).collect(),
            });
        }
        while now >= next + WINDOW_SECS + BEYOND_SECS {
            next += WINDOW_SECS;
        }
        self.places = Some((first, next));
        // whole windows are forgotten, so that what is left begins where a window does
        let spare = ((now - KEPT_SECS - first) / WINDOW_SECS).floor().max(0.0);
        self.readings.retain(|reading| reading.secs > first + spare * WINDOW_SECS - SAME_SECS);
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use ds_dynamics::case::Case;
    use ds_dynamics::drive::Drive;
    use ds_dynamics::healthy::{Healthy, learn};
    use ds_dynamics::synthetic;

    use super::*;

    fn case(folder: &Path, seed: u64, gyro_bias: f64) -> Case {
        let effect = ds_effect::find("gyro_bias").expect("the effect is in the library");
        synthetic::write_case(folder, seed, &|plant| (effect.apply)(&[gyro_bias], plant)).expect("it can be written");
        Case::read(folder).expect("the case can be read")
    }

    fn readings(drive: &Drive) -> Vec<Reading> {
        let column = |column: &Option<Vec<f64>>, k: usize| column.as_ref().expect("all channels are there")[k];
        let of = |k: usize| Reading {
            secs: drive.start_secs + k as f64 * 0.05,
            cmd_steer_rad: drive.cmd_steer[k],
            cmd_accel_mps2: drive.cmd_accel[k],
            x_m: column(&drive.x, k),
            y_m: column(&drive.y, k),
            yaw_rad: column(&drive.yaw, k),
            speed_mps: column(&drive.v, k),
            yaw_rate_radps: column(&drive.yaw_rate, k),
            ax_mps2: column(&drive.ax, k),
            ay_mps2: column(&drive.ay, k),
            steering_rad: column(&drive.steer_meas, k),
            wheel_speed_mps: column(&drive.v_wheel, k),
        };
        (0..drive.samples).map(of).collect()
    }

    #[test]
    fn a_drive_that_goes_on_alarms_where_its_log_does_and_a_healthy_one_does_not() {
        let root = tempfile::tempdir().expect("a folder");
        let healthy = [61, 62, 63].map(|seed| {
            let name = format!("day-{seed}");
            Healthy { case: case(&root.path().join(&name), seed, 0.0), name }
        });
        let baseline = Arc::new(learn(&healthy, &|| ()).expect("three healthy logs"));
        let said = |gyro_bias: f64| {
            let whole = case(&root.path().join("watched"), 72, gyro_bias);
            let drive = whole.drives[2].clone();
            let meta = VehicleMeta { drives: whole.meta.drives[2..3].to_vec(), suggested_split: None, ..whole.meta };
            let mut alarms = Alarms::new(baseline.clone(), 1.0, meta.clone()).expect("windows of three logs");
            let live: Vec<f64> = readings(&drive)
                .chunks(2)
                .flat_map(|chunk| alarms.take(chunk).expect("the same vehicle"))
                .map(|alarm| alarm.secs)
                .collect();
            let recorded = Case::new(meta, vec![drive]).expect("a case");
            let mut watch = Watch::new(baseline.clone(), 1.0).expect("windows of three logs");
            let found = watch.log("recorded", &recorded).expect("the same vehicle");
            assert_eq!(alarms.watch.windows, watch.windows);
            (live, found.iter().map(|alarm| alarm.secs).collect::<Vec<f64>>())
        };
        let (live, recorded) = said(0.01);
        assert!(!live.is_empty() && live.len() == recorded.len(), "{live:?} {recorded:?}");
        assert!(live.iter().zip(&recorded).all(|(a, b)| (a - b).abs() < 2.1), "{live:?} {recorded:?}");
        assert_eq!(said(0.0), (Vec::new(), Vec::new()));
    }

    #[test]
    fn a_baseline_of_another_car_is_refused() {
        let root = tempfile::tempdir().expect("a folder");
        let healthy = [61, 62, 63].map(|seed| {
            let name = format!("day-{seed}");
            Healthy { case: case(&root.path().join(&name), seed, 0.0), name }
        });
        let baseline = Arc::new(learn(&healthy, &|| ()).expect("three healthy logs"));
        let mut meta = healthy[0].case.meta.clone();
        meta.nominal.mass += 100.0;
        let mut alarms = Alarms::new(baseline, 1.0, meta).expect("windows of three logs");
        let refused = alarms.take(&readings(&healthy[0].case.drives[0])).expect_err("another nominal simulator");
        assert!(refused.to_string().contains("nominal simulator"), "{refused}");
    }
}
