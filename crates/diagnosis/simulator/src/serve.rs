//! The built-in car as a simulator of the protocol: the other side's example, and what the difference between another
//! simulator and the built-in one is measured against.

use std::collections::BTreeMap;
use std::io::{BufRead, Write};

use ds_diagnosis::meta::Nominal;
use ds_dynamics::ego::{Car, Push, ROLL_SECS};
use ds_effect::Plant;
use ds_vehicle::Saturation;

use crate::error::SimulatorError;
use crate::fields::{FIELDS, Field};
use crate::message::{
    DRIVE, FRONT, Failure, Hello, NEEDED, Out, ParameterEntry, REAR, Reply, Request, Reset, Snapshot, Step, VERSION,
};

/// A served built-in car; one instance.
pub struct Served {
    nominal: Nominal,
    plant: Plant,
    saturation: Saturation,
    car: Car,
    place: (f64, f64, f64),
    declares: bool,
}

impl Served {
    /// Serves a nominal car; whether its parameters can be changed, or forces at its ports must do.
    #[must_use]
    pub fn new(nominal: &Nominal, declares: bool) -> Self {
        let plant = nominal.plant();
        let car = Car::steady(&plant.vehicle, 0.0, 0.0, 0.0);
        let saturation = Saturation::new(plant.vehicle.tyre_knee);
        Self { nominal: nominal.clone(), plant, saturation, car, place: (0.0, 0.0, 0.0), declares }
    }

    /// Serves a car as it stands.
    #[must_use]
    pub fn of(nominal: &Nominal, car: &Plant) -> Self {
        let mut served = Self::new(nominal, true);
        served.plant.vehicle = car.vehicle;
        served.plant.road = car.road;
        served.saturation = Saturation::new(car.vehicle.tyre_knee);
        served
    }

    /// Says what it is.
    #[must_use]
    pub fn hello(&self) -> Hello {
        let nominal = self.nominal.plant();
        let entry = |field: &Field| ParameterEntry {
            name: field.name.to_owned(),
            unit: field.unit.to_owned(),
            nominal: (field.get)(&nominal),
            low: -1e9,
            high: 1e9,
        };
        let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        Hello {
            hello: VERSION,
            dt: ROLL_SECS,
            parameters: if self.declares { FIELDS.iter().map(entry).collect() } else { Vec::new() },
            ports: owned(&[DRIVE, FRONT, REAR]),
            channels: owned(&NEEDED),
            deterministic: true,
            snapshot: false,
            reset_state: owned(&["x", "y", "yaw", "v", "yaw_rate"]),
            instances: 1,
            includes: Vec::new(),
        }
    }

    /// Starts anew with the parameters as they stand.
    pub fn start(&mut self, state: &BTreeMap<String, f64>) {
        let of = |name: &str| state.get(name).copied().unwrap_or(0.0);
        self.place = (of("x"), of("y"), of("yaw"));
        self.car = Car::steady(&self.plant.vehicle, of("v"), of("yaw_rate"), of("yaw"));
    }

    fn reset(&mut self, reset: &Reset) -> Result<(), String> {
        self.plant = self.nominal.plant();
        for (name, value) in &reset.params {
            let field = FIELDS.iter().find(|field| field.name == name && self.declares);
            let field = field.ok_or_else(|| format!("there is no parameter {name:?}"))?;
            (field.set)(&mut self.plant, *value);
        }
        self.saturation = Saturation::new(self.plant.vehicle.tyre_knee);
        self.start(&reset.state);
        Ok(())
    }

    /// Moves on.
    ///
    /// # Errors
    /// If an input has not as many values as there are steps.
    pub fn step(&mut self, step: &Step) -> Result<Out, String> {
        let inputs = [("steer", &step.steer), ("accel", &step.accel)];
        let ports = step.ports.iter().map(|(name, values)| (name.as_str(), values));
        if let Some((name, values)) = inputs.into_iter().chain(ports).find(|(_, values)| values.len() != step.n) {
            return Err(format!("input {name:?} has {} values for {} steps", values.len(), step.n));
        }
        let port = |name: &str, k: usize| step.ports.get(name).map_or(0.0, |values| values[k]);
        let mut rows: [Vec<f64>; 7] = Default::default();
        let (sin, cos) = self.place.2.sin_cos();
        for k in 0..step.n {
            let push = Push { drive_mps2: port(DRIVE, k), front_n: port(FRONT, k), rear_n: port(REAR, k) };
            let during = self.car.step(step.steer[k], step.accel[k], &push, &self.plant, &self.saturation);
            let (x, y, yaw) = self.car.pose;
            let place = (self.place.0 + x * cos - y * sin, self.place.1 + x * sin + y * cos, self.place.2 + yaw);
            let state = &self.car.state;
            let values = [place.0, place.1, place.2, state.vx, state.yaw_rate, during.ax, during.ay];
            rows.iter_mut().zip(values).for_each(|(row, value)| row.push(value));
        }
        let channels = NEEDED.iter().map(|name| (*name).to_owned()).zip(rows).collect();
        Ok(Out { id: step.id, channels })
    }

    /// Answers a request but for hello and bye.
    pub fn answer(&mut self, request: &Request) -> Reply {
        let refused = |id: usize, text: String| Reply::Error(Failure { id, text });
        match request {
            Request::Reset(reset) => match self.reset(reset) {
                Ok(()) => Reply::Ok(reset.id),
                Err(text) => refused(reset.id, text),
            },
            Request::Step(step) => match self.step(step) {
                Ok(out) => Reply::Out(out),
                Err(text) => refused(step.id, text),
            },
            Request::Save(id) | Request::Load(Snapshot { id, .. }) => refused(*id, "there are no snapshots".to_owned()),
            Request::Hello(_) | Request::Bye(_) => refused(0, "said by itself only".to_owned()),
        }
    }

    /// Answers a line by a line, none when it is bid goodbye. Of no type parameters, so that it is compiled here, as this crate
    /// is, and not where it is called.
    fn line(&mut self, line: &str) -> Result<Option<String>, SimulatorError> {
        let text = match serde_json::from_str::<Request>(line) {
            Ok(Request::Hello(_)) => serde_json::to_string(&self.hello()),
            Ok(Request::Bye(_)) => return Ok(None),
            Ok(request) => serde_json::to_string(&self.answer(&request)),
            Err(error) => serde_json::to_string(&Reply::Error(Failure { id: 0, text: error.to_string() })),
        };
        Ok(Some(text.map_err(std::io::Error::other)? + "\n"))
    }
}

/// Serves a car until its input ends or it is bid goodbye.
///
/// # Errors
/// If a stream fails.
pub fn serve(mut served: Served, input: impl BufRead, mut output: impl Write) -> Result<(), SimulatorError> {
    for line in input.lines() {
        let Some(answer) = served.line(&line?)? else { break };
        output.write_all(answer.as_bytes())?;
        output.flush()?;
    }
    Ok(())
}
