//! What is known of an effect before any data: where it acts, where it shows, and which values are usual.
//!
//! A parameter has a *neutral* value (the effect is absent), a *slab* (the range searched when the effect is suspected)
//! and, for the small mismatch that every real vehicle has, a *nuisance* prior. Values only; nothing is fitted here.

/// The recorded channels in which an effect can show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Channel {
    /// Displacement along the heading at the start of a window, metres.
    Dx,
    /// Displacement to the left of the heading at the start of a window, metres.
    Dy,
    /// Change of heading since the start of a window, radians.
    Dyaw,
    /// Longitudinal speed from the positioning system, m/s.
    Speed,
    /// Gyro, rad/s.
    YawRate,
    /// Accelerometer, forward, m/s² of specific force.
    Ax,
    /// Accelerometer, left, m/s² of specific force.
    Ay,
    /// Position sensor of the steering actuator, radians at the road wheel.
    SteerMeas,
    /// Mean wheel speed times nominal tyre radius, m/s.
    WheelSpeed,
    /// Speed of a following vehicle, m/s.
    FollowerSpeed,
    /// Bumper-to-bumper gap of a following vehicle, metres.
    FollowerGap,
    /// Lateral position of other road users against the map, metres; in recordings with a scene only.
    AgentLateral,
    /// What other road users decide (lane changes, yielding, stepping on the road); in recordings with a scene only.
    AgentDecision,
}

impl Channel {
    /// Every channel of a table, the ego's first.
    pub const ALL: [Self; 11] = [
        Self::Dx,
        Self::Dy,
        Self::Dyaw,
        Self::Speed,
        Self::YawRate,
        Self::Ax,
        Self::Ay,
        Self::SteerMeas,
        Self::WheelSpeed,
        Self::FollowerSpeed,
        Self::FollowerGap,
    ];

    /// Returns the channel's name in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dx => "dx",
            Self::Dy => "dy",
            Self::Dyaw => "dyaw",
            Self::Speed => "v",
            Self::YawRate => "yaw_rate",
            Self::Ax => "ax",
            Self::Ay => "ay",
            Self::SteerMeas => "steer_meas",
            Self::WheelSpeed => "v_wheel",
            Self::FollowerSpeed => "agent_v",
            Self::FollowerGap => "agent_gap",
            Self::AgentLateral => "agent_lateral",
            Self::AgentDecision => "agent_decision",
        }
    }

    /// Returns the channel's place in [`Channel::ALL`]; those of a scene come after it.
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Tells whether the channel is in recordings with a scene alone, in no table.
    #[must_use]
    pub const fn of_scene(self) -> bool {
        matches!(self, Self::AgentLateral | Self::AgentDecision)
    }

    /// Tells whether the channel belongs to the following vehicles.
    #[must_use]
    pub const fn of_follower(self) -> bool {
        matches!(self, Self::FollowerSpeed | Self::FollowerGap)
    }
}

/// The point of the loop at which an effect is inserted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Insertion {
    /// Between the controller and the actuators.
    CommandPath,
    /// Inside an actuator or between it and the wheel.
    Actuator,
    /// Masses, tyres, resistances of the vehicle.
    Vehicle,
    /// Surface, slope and wind.
    Road,
    /// A sensor's reading.
    Sensor,
    /// Stamps and transport of samples.
    Clock,
    /// Other drivers.
    Agent,
    /// What the map says of the road.
    Map,
    /// Lens, shutter, exposure and sensor of a camera, and the air before it.
    Camera,
    /// The model that generates frames.
    VideoModel,
    /// The way of frames to whoever looks at them.
    Transport,
}

/// How a parameter is searched and how its search value becomes the reported one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// The search value is the reported value.
    Linear,
    /// The search value is the natural logarithm of the reported factor.
    Log,
    /// The search value is a fraction of the nominal mass; the reported value is in kilograms.
    OfMass,
    /// A limit: the search value is the logarithm, absence is an infinite limit.
    Limit,
    /// A play, rate or switch that shows only beyond a threshold: linear, but found on a grid.
    Threshold,
}

/// A normal prior of the mismatch that is always there, in search units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nuisance {
    /// Usual value; differs from neutral where every real vehicle has some of the effect.
    pub mean: f64,
    /// Standard deviation from vehicle to vehicle.
    pub sd: f64,
}

/// Wheelbases, m, of the vehicles of which the library knows what is usual of a length.
const USUAL_WHEELBASES_M: (f64, f64) = (2.4, 3.2);

/// One parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// What the number is, in one word.
    pub name: &'static str,
    /// Unit of the reported value.
    pub unit: &'static str,
    /// How search and report relate.
    pub scale: Scale,
    /// Value at which the effect is absent, in search units.
    pub neutral: f64,
    /// Range searched when the effect is suspected, in search units.
    pub slab: (f64, f64),
    /// Mismatch that every vehicle has; `None` where the effect is either there or not.
    pub nuisance: Option<Nuisance>,
    /// Whether the value is a length of the vehicle, of which a car's is nonsense in a model of it; see [`Self::sized`].
    pub is_length: bool,
}

impl Parameter {
    /// Describes a parameter that is absent at zero and searched within `slab`.
    #[must_use]
    pub const fn linear(name: &'static str, unit: &'static str, slab: (f64, f64)) -> Self {
        Self { name, unit, scale: Scale::Linear, neutral: 0.0, slab, nuisance: None, is_length: false }
    }

    /// Describes a factor; `slab` and nuisance are in natural logarithms.
    #[must_use]
    pub const fn factor(name: &'static str, slab: (f64, f64)) -> Self {
        Self { name, unit: "x", scale: Scale::Log, neutral: 0.0, slab, nuisance: None, is_length: false }
    }

    /// Describes a limit that is absent when infinite; `slab` is in natural logarithms of the limit.
    #[must_use]
    pub const fn limit(name: &'static str, unit: &'static str, slab: (f64, f64)) -> Self {
        Self { name, unit, scale: Scale::Limit, neutral: f64::INFINITY, slab, nuisance: None, is_length: false }
    }

    /// Describes a threshold-like parameter, absent at zero and searched on a grid within `slab`.
    #[must_use]
    pub const fn threshold(name: &'static str, unit: &'static str, slab: (f64, f64)) -> Self {
        Self { name, unit, scale: Scale::Threshold, neutral: 0.0, slab, nuisance: None, is_length: false }
    }

    /// Sets the value at which the effect is absent, in search units.
    #[must_use]
    pub const fn absent_at(mut self, neutral: f64) -> Self {
        self.neutral = neutral;
        self
    }

    /// Adds the mismatch that every vehicle has, in search units.
    #[must_use]
    pub const fn usual(mut self, mean: f64, sd: f64) -> Self {
        self.nuisance = Some(Nuisance { mean, sd });
        self
    }

    /// Searches a fraction of the nominal mass instead of kilograms.
    #[must_use]
    pub const fn of_mass(mut self) -> Self {
        self.scale = Scale::OfMass;
        self
    }

    /// Lets range and usual values go with the size of the vehicle.
    #[must_use]
    pub const fn of_size(mut self) -> Self {
        self.is_length = true;
        self
    }

    /// Returns the parameter of a vehicle of some wheelbase, m: range and usual values of a length are those of cars, and as
    /// much smaller or larger as the wheelbase is beyond theirs.
    #[must_use]
    pub fn sized(mut self, wheelbase_m: f64) -> Self {
        if self.is_length {
            let (least, most) = USUAL_WHEELBASES_M;
            let size = wheelbase_m / wheelbase_m.clamp(least, most);
            self.slab = (size * self.slab.0, size * self.slab.1);
            self.nuisance = self.nuisance.map(|n| Nuisance { mean: size * n.mean, sd: size * n.sd });
        }
        self
    }

    /// Returns the reported value of a search value, for a vehicle of `mass_kg`.
    #[must_use]
    pub fn reported(&self, search: f64, mass_kg: f64) -> f64 {
        match self.scale {
            Scale::Linear | Scale::Threshold => search,
            Scale::Log | Scale::Limit => search.exp(),
            Scale::OfMass => search * mass_kg,
        }
    }

    /// Returns the search value of a reported value, for a vehicle of `mass_kg`.
    #[must_use]
    pub fn searched(&self, reported: f64, mass_kg: f64) -> f64 {
        match self.scale {
            Scale::Linear | Scale::Threshold => reported,
            Scale::Log | Scale::Limit => reported.ln(),
            Scale::OfMass => reported / mass_kg,
        }
    }

    /// Returns the width of the slab in search units.
    #[must_use]
    pub fn width(&self) -> f64 {
        self.slab.1 - self.slab.0
    }

    /// Tells whether the effect can only be found by trying values (its slope at the neutral value is no guide).
    #[must_use]
    pub const fn on_grid(&self) -> bool {
        matches!(self.scale, Scale::Limit | Scale::Threshold)
    }

    /// Tells whether the effect shows only some way off its neutral value, as friction does when the tyres slide.
    #[must_use]
    pub fn starts_late(&self) -> bool {
        matches!(self.scale, Scale::Log) && self.slab.1 <= self.neutral
    }
}
