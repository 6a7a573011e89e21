//! What a law may be made of at each port, and how large its signals are in the drives at hand.
//!
//! Only a convention tells ports apart whose forces do alike: slip is offered at the axles alone, commands at the steering and
//! the drive alone. Terms of one group stand for one shape with several inner numbers; a law has one of them at most.

use std::collections::BTreeMap;

use ds_dynamics::case::PartModel;
use ds_dynamics::ego::actuate;
use ds_dynamics::space::Part;
use ds_effect::law::{Expression, Term};
use ds_effect::plant::Vehicle;
use ds_effect::{Channel, Law, Plant, Port};
use rayon::prelude::*;

/// Samples between those at which signals are measured.
const STRIDE: usize = 4;
/// Share of the samples beyond each end of a signal's domain.
const BEYOND: f64 = 0.01;
/// Least size of a term over the largest one's, in units of its prior, that is worth a column.
const LEAST: f64 = 1e-9;

const STEERING: &str = "1 t v delta delta*abs(delta) delta*delta*delta delta*v delta*v*v delta*abs(ay) ay delta_rate
    sign(delta_rate) sign(ay) slack(delta,0.004) slack(delta,0.01) slack(delta,0.025) stick(delta,0.004)
    stick(delta,0.006) stick(delta,0.008) stick(delta,0.01) stick(delta,0.012) stick(delta,0.015) late(delta,0.1) late(delta,0.25)
    slow(delta,0.15) slow(delta,0.4) ring(delta,0.5) pos(accel) neg(accel) delta*pos(accel) delta*neg(accel)";
const DRIVE: &str = "1 t v v*v accel pos(accel) neg(accel) accel*abs(accel) v*pos(accel) v*neg(accel) v*v*neg(accel)
    sign(accel) pos(accel,0.6) pos(accel,1.5) neg(accel,0.6) neg(accel,1.5) late(accel,0.15) late(accel,0.4)
    slow(accel,0.3) slow(accel,0.8) rise(accel,0.4) fall(accel,0.4) ring(accel,0.8) ring(accel,2) slack(accel,0.3) abs(ay)
    abs(delta) ay*ay";
const FRONT: &str = "1 t slip_front slip_front*abs(slip_front) slip_front*slip_front*slip_front slip_front*v
    slip_front*v*v slip_front*ax slip_front*pos(ax) slip_front*neg(ax) slip_front*abs(ay) v*yaw_rate";
const REAR: &str = "1 t slip_rear slip_rear*abs(slip_rear) slip_rear*slip_rear*slip_rear slip_rear*v slip_rear*v*v
    slip_rear*ax slip_rear*pos(ax) slip_rear*neg(ax) slip_rear*abs(ay) v*yaw_rate";
const BODY: &str = "1 t v v*v yaw_rate yaw_rate*v yaw_rate*abs(yaw_rate) ay ay*abs(ay) ay*ax sign(yaw_rate)
    v*v*ring(delta,0.8) v*v*ring(delta,2)";
const SENSOR: &str = "1 t v v*v ax ay yaw_rate abs(ay) abs(yaw_rate) yaw_rate*v yaw_rate*abs(yaw_rate) ay*abs(ay)
    ax*abs(ax) pos(ax) neg(ax) delta delta*abs(delta) delta_rate";
const POSITION: &str = "t s";
const FOLLOWER: &str = "1 t v v*v gap dv dv*abs(dv) pos(dv) neg(dv) v_lead v*dv gap*dv pos(gap,30)";

/// Returns a number as it is written: four digits.
pub(crate) fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// One term of one port.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// What it multiplies, with the domains of the drives.
    pub(crate) expression: Expression,
    /// Coefficient at which it is as large as usual: the unit in which it is searched.
    pub(crate) scale: f64,
    /// Terms of one group exclude each other.
    pub(crate) group: String,
}

/// Returns the ports of a part of the loop.
pub(crate) fn ports(part: Part) -> Vec<Port> {
    Port::all().into_iter().filter(|port| (*port == Port::Follower) == (part == Part::Following)).collect()
}

fn texts(port: Port) -> &'static str {
    match port {
        Port::Steering | Port::Linkage => STEERING,
        Port::Drive => DRIVE,
        Port::Front => FRONT,
        Port::Rear => REAR,
        Port::Yaw | Port::Side => BODY,
        Port::Sensor(Channel::Dx | Channel::Dy) => POSITION,
        Port::Sensor(_) => SENSOR,
        Port::Follower => FOLLOWER,
    }
}

/// Returns what is usual of a signal at a port, in its unit: the standard deviation that is believed beforehand.
pub(crate) fn usual(port: Port, vehicle: &Vehicle) -> f64 {
    let weight_n = vehicle.mass_kg * 9.81;
    match port {
        Port::Steering | Port::Linkage => 0.02,
        Port::Drive => 0.6,
        Port::Front | Port::Rear | Port::Side => 0.05 * weight_n,
        Port::Yaw => 0.05 * weight_n * vehicle.front_arm_m,
        Port::Sensor(Channel::Dyaw | Channel::YawRate) => 0.03,
        Port::Sensor(Channel::SteerMeas) => 0.01,
        Port::Sensor(Channel::Dx | Channel::Dy) => 0.3,
        Port::Sensor(Channel::Ax | Channel::Ay) | Port::Follower => 0.4,
        Port::Sensor(_) => 0.6,
    }
}

/// The signals of the drives at hand, for sizes and domains of expressions.
pub(crate) struct Signals<'m, 'c> {
    model: &'m PartModel<'c>,
    vector: Vec<f64>,
    vehicle: Vehicle,
    domain: BTreeMap<&'static str, [f64; 2]>,
}

impl<'m, 'c> Signals<'m, 'c> {
    /// Measures the signals of a model's drives, commands as the simulator of a vector makes them.
    pub(crate) fn new(model: &'m PartModel<'c>, vector: &[f64]) -> Self {
        let vehicle = model.space.plant(vector).vehicle;
        let mut signals = Self { model, vector: vector.to_vec(), vehicle, domain: BTreeMap::new() };
        let names = ["delta", "delta_rate", "accel", "t", "s", "v", "ax", "ay", "yaw_rate", "slip_front", "slip_rear"];
        let names = names.into_iter().chain(["gap", "dv", "v_lead"]);
        for name in names {
            let Ok(expression) = Expression::parse(name) else { continue };
            let mut values = signals.values(&expression);
            values.sort_by(f64::total_cmp);
            if let Some(last) = values.len().checked_sub(1) {
                let at = |share: f64| values[(share * last as f64).round() as usize];
                signals.domain.insert(name, [at(BEYOND), at(1.0 - BEYOND)].map(rounded));
            }
        }
        signals
    }

    /// Returns what an expression is at samples of all drives.
    pub(crate) fn values(&self, expression: &Expression) -> Vec<f64> {
        let of_car = self.model.records().next().is_some();
        let port = if of_car { Port::Drive } else { Port::Follower };
        let term = Term { coefficient: 1.0, expression: expression.clone() };
        let Ok(law) = Law::new(port, vec![term]) else { return Vec::new() };
        let mut out = Vec::new();
        let plant = Plant { laws: vec![law], ..self.model.space.plant(&self.vector) };
        for record in self.model.records() {
            let actuated = actuate(&record.inputs, &plant);
            for sample in (0..record.samples()).step_by(STRIDE) {
                let felt = record.felt(sample, &plant.vehicle);
                out.push(actuated.added(&plant.laws, record.secs(sample), &felt, |_| true));
            }
        }
        for record in self.model.followers() {
            for &start in &record.starts {
                out.push(plant.laws[0].at(|_| 1.0, &record.felt(start)));
            }
        }
        out
    }

    /// Returns the range of each signal in the drives.
    pub(crate) fn domain(&self, name: &str) -> Option<[f64; 2]> {
        self.domain.get(name).copied()
    }

    /// Returns the candidates of a port that are not nil in these drives.
    pub(crate) fn candidates(&self, port: Port, lines_hz: &[f64]) -> Vec<Candidate> {
        let own = usual(port, &self.vehicle);
        let mut texts: Vec<String> = texts(port).split_whitespace().map(str::to_owned).collect();
        let modulated = if port == Port::Drive { &["", "pos(accel)*", "neg(accel)*"][..] } else { &[""] };
        for (hz, by) in lines_hz.iter().flat_map(|hz| modulated.iter().map(move |by| (hz, by))) {
            texts.extend(["sin", "cos"].map(|wave| format!("{by}{wave}({hz})")));
        }
        texts.par_iter().filter_map(|text| self.candidate(text, own)).collect()
    }

    fn candidate(&self, text: &str, usual: f64) -> Option<Candidate> {
        let expression = Expression::parse(text).ok()?.within(|name| self.domain(name));
        self.sized(expression, usual)
    }

    /// Returns a candidate of an expression.
    pub(crate) fn sized(&self, expression: Expression, usual: f64) -> Option<Candidate> {
        let values = self.values(&expression);
        let square: f64 = values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64;
        let size = square.sqrt();
        let text = expression.bare();
        let group = text.split_once(',').map_or_else(|| text.clone(), |(shape, _)| shape.to_owned());
        (size.is_finite() && size > LEAST).then(|| Candidate { expression, scale: usual / size, group })
    }

    /// Returns a candidate with another inner number, of the same usual size.
    pub(crate) fn stretched(&self, port: Port, candidate: &Candidate, factor: f64) -> Option<Candidate> {
        let expression = candidate.expression.stretched(factor)?;
        self.sized(expression, usual(port, &self.vehicle))
    }
}
