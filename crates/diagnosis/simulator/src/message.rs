//! The messages, one JSON object a line: requests to a simulator and its replies. SI units, x forward, y left.

use std::collections::BTreeMap;

use ds_effect::Port;
use serde::{Deserialize, Serialize};

use crate::error::SimulatorError;

/// Version of the protocol.
pub(crate) const VERSION: u32 = 1;
/// Channels that a diagnosis needs.
pub(crate) const NEEDED: [&str; 7] = ["x", "y", "yaw", "v", "yaw_rate", "ax", "ay"];
/// Their values at one time, in this order.
pub(crate) type Row = [f64; 7];
/// Forward force over nominal mass at the centre of gravity, m/s².
pub(crate) const DRIVE: &str = "drive";
/// Force to the left at the front axle, N.
pub(crate) const FRONT: &str = "lateral.front";
/// Force to the left at the rear axle, N.
pub(crate) const REAR: &str = "lateral.rear";

/// What a simulator is asked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Request {
    /// What it is.
    Hello(u32),
    /// Start anew.
    Reset(Reset),
    /// Go on.
    Step(Step),
    /// Give a snapshot of an instance.
    Save(usize),
    /// Go back to a snapshot.
    Load(Snapshot),
    /// End.
    Bye(u32),
}

impl Request {
    /// Returns its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Hello(_) => "hello",
            Self::Reset(_) => "reset",
            Self::Step(_) => "step",
            Self::Save(_) => "save",
            Self::Load(_) => "load",
            Self::Bye(_) => "bye",
        }
    }
}

/// Starts an instance in a state.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Reset {
    /// Instance.
    pub id: usize,
    /// State by channel.
    pub state: BTreeMap<String, f64>,
    /// Parameters that differ from nominal.
    #[serde(default)]
    pub params: BTreeMap<String, f64>,
    /// Seed of whatever is drawn.
    #[serde(default)]
    pub seed: u64,
}

/// Moves an instance on by `n` steps; each input has a value for every step, that of its middle.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Instance.
    pub id: usize,
    /// Number of steps.
    pub n: usize,
    /// Steering angle of the wheels, rad.
    pub steer: Vec<f64>,
    /// Drive or brake force over nominal mass, m/s².
    pub accel: Vec<f64>,
    /// Inputs at ports; absent ones are 0.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub ports: BTreeMap<String, Vec<f64>>,
}

/// An instance's state in the simulator's own words.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Instance.
    pub id: usize,
    /// Its state.
    pub snapshot: String,
}

/// What a simulator answers, but for its hello.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reply {
    /// Done, for an instance.
    Ok(usize),
    /// The steps' ends.
    Out(Out),
    /// A snapshot.
    Saved(Snapshot),
    /// Refused.
    Error(Failure),
}

/// Channels at the end of each step.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Out {
    /// Instance.
    pub id: usize,
    /// Values by channel.
    #[serde(flatten)]
    pub channels: BTreeMap<String, Vec<f64>>,
}

/// Why a request was refused.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// Instance.
    #[serde(default)]
    pub id: usize,
    /// In words.
    pub text: String,
}

/// What a simulator says of itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Version of the protocol.
    pub hello: u32,
    /// Its step, s.
    pub dt: f64,
    /// What can be changed at a reset.
    #[serde(default)]
    pub parameters: Vec<ParameterEntry>,
    /// Where forces and angles can be put in.
    #[serde(default)]
    pub ports: Vec<String>,
    /// What it tells of each step.
    pub channels: Vec<String>,
    /// Whether equal requests have equal answers.
    #[serde(default = "yes")]
    pub deterministic: bool,
    /// Whether it can save and load.
    #[serde(default)]
    pub snapshot: bool,
    /// What a reset can set.
    pub reset_state: Vec<String>,
    /// How many instances it runs beside each other.
    #[serde(default = "one")]
    pub instances: usize,
    /// Mismatch of the single track that this simulator has physics of its own for, by the library's ids.
    #[serde(default)]
    pub includes: Vec<String>,
}

/// A parameter of a simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterEntry {
    /// One of the names of the single track, see `fields.rs`.
    pub name: String,
    /// Its unit.
    #[serde(default)]
    pub unit: String,
    /// Its value unless a reset says otherwise.
    pub nominal: f64,
    /// Least value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
}

fn yes() -> bool {
    true
}

fn one() -> usize {
    1
}

impl Hello {
    /// Checks what the types do not say.
    ///
    /// # Errors
    /// If a diagnosis cannot work with such a simulator.
    pub fn check(&self) -> Result<(), SimulatorError> {
        let wrong = |field: &str, value: String, expected: &'static str| {
            Err(SimulatorError::Hello { field: field.to_owned(), value, expected })
        };
        if self.hello != VERSION {
            return wrong("hello", self.hello.to_string(), "version 1");
        }
        if !(1e-4..=0.1).contains(&self.dt) {
            return wrong("dt", self.dt.to_string(), "0.0001 to 0.1 s");
        }
        for parameter in &self.parameters {
            let ordered = parameter.low <= parameter.nominal && parameter.nominal <= parameter.high;
            if !ordered {
                let value = format!("{} in {} to {}", parameter.nominal, parameter.low, parameter.high);
                return wrong(&format!("parameters.{}", parameter.name), value, "low <= nominal <= high");
            }
        }
        if let Some(absent) = NEEDED.iter().find(|name| !self.channels.iter().any(|c| c == *name)) {
            return wrong(
                "channels",
                format!("{:?} without {absent:?}", self.channels),
                "x, y, yaw, v, yaw_rate, ax, ay",
            );
        }
        if !self.reset_state.iter().any(|name| name == "v") {
            return wrong("reset_state", format!("{:?}", self.reset_state), "at least v: windows start in motion");
        }
        Ok(())
    }

    /// Returns what kind of simulator it is, whichever values its parameters have.
    #[must_use]
    pub fn kind(&self) -> String {
        let parameters: Vec<&str> = self.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
        let (parameters, ports, includes) = (parameters.join(" "), self.ports.join(" "), self.includes.join(" "));
        format!("step {} s, parameters [{parameters}], ports [{ports}], includes [{includes}]", self.dt)
    }

    /// Tells whether a law can be put in at a port: steering goes with the angle of the wheels, readings and followers lie
    /// outside the simulator.
    #[must_use]
    pub fn takes(&self, port: Port) -> bool {
        match port {
            Port::Drive => self.port(DRIVE),
            Port::Front => self.port(FRONT),
            Port::Rear => self.port(REAR),
            Port::Yaw | Port::Side => self.port(FRONT) && self.port(REAR),
            Port::Steering | Port::Linkage | Port::Sensor(_) | Port::Follower => true,
        }
    }

    /// Tells whether a port is there.
    #[must_use]
    pub fn port(&self, name: &str) -> bool {
        self.ports.iter().any(|port| port == name)
    }
}
