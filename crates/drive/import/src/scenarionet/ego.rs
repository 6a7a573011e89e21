//! The ego log: rear axle poses as recorded, speeds, rates and accelerations from local least-squares fits.
//!
//! A point on a car moves along its heading only at the rear axle: elsewhere it slips by (distance ahead) × curvature.
//! The slope of slip over curvature thus tells which point a log gives; over the six nuScenes drives of the tests it
//! is -0.05 m, so ScenarioNet's nuScenes positions are the rear axle, not the centre 1.2 m ahead of it.

use ds_scenario::Warning;
use ds_space::{DVec2, PoseSe2, angle};
use ds_world::{EgoState, Size, VehicleParameters};

use super::Window;
use crate::view::{FieldFault, View};

/// The ego vehicle and its drive.
#[derive(Debug)]
pub(super) struct Log {
    pub vehicle: VehicleParameters,
    pub states: Vec<EgoState>,
    pub window: Window,
}

/// How far a step may differ from those around it, in metres.
const JUMP_M: f64 = 0.1;
/// Positions beyond this are moved to an origin at the start of the log, in metres.
pub(crate) const RECENTRE_BEYOND_M: f64 = 1e5;

pub(super) fn log(track: &View<'_>, dt_secs: f64, dataset: &str, notes: &mut Vec<Warning>) -> Result<Log, FieldFault> {
    let state = track.need("state")?;
    let position = state.need("position")?.points()?;
    let heading = state.need("heading")?.table()?;
    let valid = match state.get("valid") {
        Some(valid) => valid.table()?.values,
        None => vec![1.0; position.len()],
    };
    if heading.rows != position.len() || valid.len() != position.len() {
        let problem =
            format!("has {} positions, {} headings and {} valid marks", position.len(), heading.rows, valid.len());
        return Err(state.fault(problem));
    }
    let is_valid = |tick: &usize| valid[*tick] != 0.0;
    let first = (0..position.len()).find(is_valid).ok_or_else(|| state.fault("is never valid"))?;
    let last = (0..position.len()).rfind(is_valid).unwrap_or(first);
    if last == first || last - first >= ds_scenario::MAX_TICKS {
        return Err(state.fault(format!(
            "is valid over {} ticks, 2 to {} are read",
            last - first + 1,
            ds_scenario::MAX_TICKS
        )));
    }
    let far = position[first].abs().max_element() > RECENTRE_BEYOND_M;
    let origin = if far { position[first].round() } else { DVec2::ZERO };
    if far {
        notes.push(Warning { at: "tracks".to_owned(), message: format!("all positions are moved by -{origin}") });
    }
    let window = Window { origin, first, count: last - first + 1 };
    let headings: Vec<f64> = (first..=last).map(|tick| heading.get(tick, 0)).collect();
    if let Some(tick) = headings.iter().position(|heading| !heading.is_finite()) {
        return Err(state.fault(format!("has heading[{}] {}", first + tick, headings[tick])));
    }
    let points: Vec<DVec2> = position[first..=last].iter().map(|point| *point - origin).collect();
    let way = |tick: usize| position[tick].distance(position[first]);
    if let Some(tick) = (first..=last).filter(is_valid).find(|tick| way(*tick) > RECENTRE_BEYOND_M) {
        return Err(state.fault(format!("has position[{tick}] {} m from the first", way(tick))));
    }
    let gaps: Vec<bool> = (first..=last).map(|tick| !is_valid(&tick)).collect();
    let vehicle = vehicle(&state, dataset, notes);
    let states = Recording { points, headings, gaps, dt_secs }.states(&vehicle, dataset, track.at(), notes);
    Ok(Log { vehicle, states, window })
}

/// A recorded path, one point and heading per tick; where there is a gap, neither counts.
#[derive(Debug)]
pub(crate) struct Recording {
    pub points: Vec<DVec2>,
    pub headings: Vec<f64>,
    pub gaps: Vec<bool>,
    pub dt_secs: f64,
}

impl Recording {
    /// Returns the states at the rear axle.
    pub(crate) fn states(
        mut self,
        vehicle: &VehicleParameters,
        dataset: &str,
        at: &str,
        notes: &mut Vec<Warning>,
    ) -> Vec<EgoState> {
        self.mend();
        let ahead_m = reference(&self.points, &self.headings, vehicle, dataset);
        if ahead_m > 0.0 {
            let message = format!("positions are the box centre; moved back {ahead_m:.3} m to the rear axle");
            notes.push(Warning { at: at.to_owned(), message });
        }
        self.behind(ahead_m, vehicle)
    }

    /// Returns the states at the rear axle of a path that is known to be that of the box's centre.
    pub(crate) fn centred(mut self, vehicle: &VehicleParameters) -> Vec<EgoState> {
        self.mend();
        self.behind(vehicle.rear_axle_to_centre_m, vehicle)
    }

    /// Unwraps headings and fills gaps.
    fn mend(&mut self) {
        for i in 1..self.headings.len() {
            self.headings[i] = self.headings[i - 1] + angle::turn(self.headings[i - 1], self.headings[i]);
        }
        fill(&mut self.points, &mut self.headings, &self.gaps);
    }

    fn behind(mut self, ahead_m: f64, vehicle: &VehicleParameters) -> Vec<EgoState> {
        for (point, heading) in self.points.iter_mut().zip(&self.headings) {
            *point -= DVec2::from_angle(*heading) * ahead_m;
        }
        states(&self.points, &self.headings, vehicle, self.dt_secs)
    }
}

/// Fills ticks without a valid state between their neighbours.
fn fill(points: &mut [DVec2], headings: &mut [f64], gaps: &[bool]) {
    let mut before = 0;
    for i in 1..points.len() {
        if gaps[i] {
            continue;
        }
        for gap in before + 1..i {
            let share = (gap - before) as f64 / (i - before) as f64;
            points[gap] = points[before].lerp(points[i], share);
            headings[gap] = headings[before] + (headings[i] - headings[before]) * share;
        }
        before = i;
    }
}

fn vehicle(state: &View<'_>, dataset: &str, notes: &mut Vec<Warning>) -> VehicleParameters {
    let base = if dataset == "nuscenes" { VehicleParameters::ZOE } else { VehicleParameters::PACIFICA };
    let size = |name| state.get(name).and_then(|value| value.number()).filter(|value| *value > 0.3 && *value < 30.0);
    let (Some(mut length_m), Some(mut width_m)) = (size("length"), size("width")) else { return base };
    if length_m < width_m {
        notes.push(Warning {
            at: state.at().to_owned(),
            message: format!("length {length_m} and width {width_m} of the ego are swapped; put right"),
        });
        std::mem::swap(&mut length_m, &mut width_m);
    }
    sized(base, Size { length_m, width_m, height_m: size("height").unwrap_or(base.size.height_m) })
}

/// Returns a vehicle of a size, its axles placed as in another one.
pub(crate) fn sized(base: VehicleParameters, size: Size) -> VehicleParameters {
    let scale = size.length_m / base.size.length_m;
    VehicleParameters {
        size,
        wheel_base_m: ds_scenario::rounded(base.wheel_base_m * scale, 1e3),
        rear_axle_to_centre_m: ds_scenario::rounded(base.rear_axle_to_centre_m * scale, 1e3),
        ..base
    }
}

/// Returns how far ahead of the rear axle the logged point lies: 0, or the distance to the centre.
fn reference(points: &[DVec2], headings: &[f64], vehicle: &VehicleParameters, dataset: &str) -> f64 {
    let centre_m = vehicle.rear_axle_to_centre_m;
    let default = if dataset == "nuscenes" { 0.0 } else { centre_m };
    let Some((slope_m, doubt_m)) = slip_slope(points, headings) else { return default };
    if doubt_m > 0.15 * centre_m {
        return default;
    }
    if (slope_m - centre_m).abs() < slope_m.abs() { centre_m } else { 0.0 }
}

/// Returns the slope of slip over curvature in metres and its standard error, if the drive turns enough to tell.
pub(super) fn slip_slope(points: &[DVec2], headings: &[f64]) -> Option<(f64, f64)> {
    let mut samples: Vec<(f64, f64)> = Vec::new();
    for i in 2..points.len().saturating_sub(2) {
        let moved = points[i + 2] - points[i - 2];
        let length_m = moved.length();
        if length_m > 1.2 {
            let curvature = (headings[i + 2] - headings[i - 2]) / length_m;
            let slip = DVec2::from_angle(headings[i]).perp_dot(moved) / length_m;
            if curvature.abs() < 0.3 {
                samples.push((curvature, slip));
            }
        }
    }
    let count = samples.len() as f64;
    if samples.len() < 20 {
        return None;
    }
    let mean = samples.iter().fold((0.0, 0.0), |sum, sample| (sum.0 + sample.0 / count, sum.1 + sample.1 / count));
    let spread: f64 = samples.iter().map(|sample| (sample.0 - mean.0).powi(2)).sum();
    if spread < 1e-4 {
        return None;
    }
    let slope = samples.iter().map(|sample| (sample.0 - mean.0) * (sample.1 - mean.1)).sum::<f64>() / spread;
    let rest: f64 = samples.iter().map(|sample| (sample.1 - mean.1 - slope * (sample.0 - mean.0)).powi(2)).sum();
    // Neighbouring samples share ticks, so that about a quarter of them is independent.
    Some((slope, (4.0 * rest / count / spread).sqrt()))
}

/// Fits a parabola over the ticks around one and returns its slope and curvature there, per tick.
///
/// Near the ends of the log, where ticks lie to one side only, twice as many are taken.
fn fit(values: &[f64], at: usize, reach: usize) -> (f64, f64) {
    let last = values.len() - 1;
    let (low, high) = if at < reach {
        (0, (4 * reach).min(last))
    } else if at + reach > last {
        (last.saturating_sub(4 * reach), last)
    } else {
        (at - reach, at + reach)
    };
    let mut moments = [0.0; 5];
    let mut sums = [0.0; 3];
    for (i, value) in values.iter().enumerate().take(high + 1).skip(low) {
        let x = i as f64 - at as f64;
        let mut power = 1.0;
        for (k, moment) in moments.iter_mut().enumerate() {
            *moment += power;
            if k < 3 {
                sums[k] += power * (value - values[at]);
            }
            power *= x;
        }
    }
    if high - low < 2 {
        return (values[high] - values[low], 0.0);
    }
    let [a, b, c, d, e] = moments;
    let determinant = a * (c * e - d * d) - b * (b * e - c * d) + c * (b * d - c * c);
    let slope = a * (sums[1] * e - d * sums[2]) - sums[0] * (b * e - c * d) + c * (b * sums[2] - sums[1] * c);
    let bend = a * (c * sums[2] - sums[1] * d) - b * (b * sums[2] - sums[1] * c) + sums[0] * (b * d - c * c);
    (slope / determinant, 2.0 * bend / determinant)
}

/// Returns the points without jumps, for the estimation of speeds only.
///
/// The nuScenes drives jump near their end, some backwards by more than a metre. A step that differs by more than
/// [`JUMP_M`] from the middle one of the steps around it is replaced by that.
fn mended(points: &[DVec2], headings: &[f64]) -> Vec<DVec2> {
    let step = |i: usize| DVec2::from_angle(-headings[i]).rotate(points[i + 1] - points[i]);
    let steps: Vec<DVec2> = (0..points.len() - 1).map(step).collect();
    let mut mended = vec![points[0]];
    for (i, step) in steps.iter().enumerate() {
        let low = i.saturating_sub(3).min(steps.len().saturating_sub(7));
        let around = &steps[low..(low + 7).min(steps.len())];
        let middle = DVec2::new(middle(around.iter().map(|step| step.x)), middle(around.iter().map(|step| step.y)));
        let sound = if step.distance(middle) > JUMP_M { middle } else { *step };
        mended.push(mended[i] + DVec2::from_angle(headings[i]).rotate(sound));
    }
    mended
}

fn middle(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn states(points: &[DVec2], headings: &[f64], vehicle: &VehicleParameters, dt_secs: f64) -> Vec<EgoState> {
    let reach = ((0.4 / dt_secs).round() as usize).max(2);
    let (xs, ys): (Vec<f64>, Vec<f64>) = mended(points, headings).iter().map(|point| (point.x, point.y)).unzip();
    let mut states: Vec<EgoState> = Vec::with_capacity(points.len());
    for i in 0..points.len() {
        let ((vx, ax), (vy, ay)) = (fit(&xs, i, reach), fit(&ys, i, reach));
        let pose = PoseSe2 { position: points[i], heading_rad: angle::wrap(headings[i]) };
        let to_rig = DVec2::from_angle(-headings[i]);
        let velocity = to_rig.rotate(DVec2::new(vx, vy) / dt_secs);
        let acceleration = to_rig.rotate(DVec2::new(ax, ay) / (dt_secs * dt_secs));
        let yaw_rate = fit(headings, i, reach).0 / dt_secs;
        let held = states.last().map_or(0.0, |state| state.steering_rad);
        let steering = if velocity.x > 0.7 { (vehicle.wheel_base_m * yaw_rate / velocity.x).atan() } else { held };
        states.push(EgoState {
            pose,
            velocity_mps: velocity,
            yaw_rate_radps: yaw_rate,
            acceleration_mps2: acceleration,
            steering_rad: steering.clamp(-vehicle.max_steering_rad, vehicle.max_steering_rad),
            steering_rate_radps: 0.0,
        });
    }
    let steering: Vec<f64> = states.iter().map(|state| state.steering_rad).collect();
    for (i, state) in states.iter_mut().enumerate() {
        let rate = fit(&steering, i, reach).0 / dt_secs;
        state.steering_rate_radps = rate.clamp(-vehicle.max_steering_rate_radps, vehicle.max_steering_rate_radps);
    }
    states
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fits_give_the_derivatives_of_a_parabola() {
        let values: Vec<f64> = (0..20).map(|i| 3.0 + 0.5 * f64::from(i) + 0.25 * f64::from(i * i)).collect();
        for at in [0, 1, 7, 19] {
            let (slope, bend) = fit(&values, at, 4);
            assert!(
                (slope - (0.5 + 0.5 * at as f64)).abs() < 1e-9 && (bend - 0.5).abs() < 1e-9,
                "{at}: {slope} {bend}"
            );
        }
    }

    #[test]
    fn a_jump_does_not_change_the_speeds() {
        let headings = vec![0.3; 60];
        let even: Vec<DVec2> = (0..60).map(|i| DVec2::from_angle(0.3) * f64::from(i)).collect();
        let mut jumping = even.clone();
        jumping[58..].iter_mut().for_each(|point| *point -= DVec2::from_angle(0.3) * 2.0);
        jumping[30..].iter_mut().for_each(|point| *point += DVec2::new(0.5, 0.0));
        for state in states(&jumping, &headings, &VehicleParameters::ZOE, 0.1) {
            assert!((state.velocity_mps - DVec2::new(10.0, 0.0)).length() < 1e-6, "{:?}", state.velocity_mps);
        }
    }

    #[test]
    fn the_logged_point_is_told_from_the_drive() {
        let vehicle = VehicleParameters::PACIFICA;
        for ahead_m in [0.0, vehicle.rear_axle_to_centre_m] {
            let headings: Vec<f64> = (0..80).map(|i| 0.3 * (f64::from(i) * 0.1).sin()).collect();
            let mut rear = DVec2::ZERO;
            let mut points = Vec::new();
            for heading in &headings {
                points.push(rear + DVec2::from_angle(*heading) * ahead_m);
                rear += DVec2::from_angle(*heading) * 0.6;
            }
            for dataset in ["nuscenes", "waymo"] {
                assert!((reference(&points, &headings, &vehicle, dataset) - ahead_m).abs() < 1e-9);
            }
        }
    }
}
