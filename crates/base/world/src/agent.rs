//! Other road users: their class, size, recorded track and state.

use ds_space::plane::OrientedBox;
use ds_space::{AgentId, DVec2, PoseSe2, Tick};

/// What kind of road user or object an agent is. The order stays: digests of scenes count by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum AgentClass {
    /// Cars, trucks, buses.
    Vehicle,
    /// People on foot.
    Pedestrian,
    /// Bicycles and motorcycles with their riders.
    Cyclist,
    /// Traffic cones.
    Cone,
    /// Barriers.
    Barrier,
}

impl AgentClass {
    /// Says whether the agent never moves by itself.
    #[must_use]
    pub fn is_static(self) -> bool {
        matches!(self, Self::Cone | Self::Barrier)
    }
}

/// The size of a box, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Size {
    /// Along the heading.
    pub length_m: f64,
    /// Across the heading.
    pub width_m: f64,
    /// Upwards.
    pub height_m: f64,
}

impl Size {
    /// Returns what a box of this size covers of the ground, standing around a centre.
    #[must_use]
    pub fn footprint(&self, centre: &PoseSe2) -> OrientedBox {
        OrientedBox::new(centre, self.length_m, self.width_m)
    }
}

/// One recorded state of a track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPoint {
    /// Centre of the box and its heading, in the world.
    pub pose: PoseSe2,
    /// Height of the bottom of the box above the ground plane, in metres.
    pub z_m: f64,
    /// Velocity in the world, in metres per second.
    pub velocity_mps: DVec2,
}

/// A recorded agent over the whole scenario.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// The name in the scenario file.
    pub name: String,
    /// Its class.
    pub class: AgentClass,
    /// Its size.
    pub size: Size,
    /// One entry per tick, `None` where the agent was not seen.
    pub points: Vec<Option<TrackPoint>>,
}

impl Track {
    /// Returns the recorded state at a tick, if there is one.
    #[must_use]
    pub fn at(&self, tick: Tick) -> Option<&TrackPoint> {
        self.points.get(tick.0 as usize).and_then(Option::as_ref)
    }
}

/// The state of a live agent at one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct AgentState {
    /// Index of the agent's track.
    pub id: AgentId,
    /// Its class.
    pub class: AgentClass,
    /// Its size.
    pub size: Size,
    /// Centre of the box and its heading, in the world.
    pub pose: PoseSe2,
    /// Height of the bottom of the box above the ground plane, in metres.
    pub z_m: f64,
    /// Velocity in the world, in metres per second.
    pub velocity_mps: DVec2,
}

impl AgentState {
    /// Returns what the box covers of the ground.
    #[must_use]
    pub fn footprint(&self) -> OrientedBox {
        self.size.footprint(&self.pose)
    }

    /// Returns the four corners of the box in the world, counter-clockwise from front left.
    #[must_use]
    pub fn corners(&self) -> [DVec2; 4] {
        corners(&self.pose, self.size.length_m, self.size.width_m)
    }
}

/// Returns the corners of a box around its centre, counter-clockwise from front left.
#[must_use]
pub fn corners(centre: &PoseSe2, length_m: f64, width_m: f64) -> [DVec2; 4] {
    let (l, w) = (0.5 * length_m, 0.5 * width_m);
    [DVec2::new(l, w), DVec2::new(-l, w), DVec2::new(-l, -w), DVec2::new(l, -w)].map(|local| centre.to_outer(local))
}
