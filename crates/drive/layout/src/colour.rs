//! The colour table of the layout image: one place, 8-bit sRGB, meant to be told apart by a network and by eye.
//!
//! | what | red, green, blue |
//! |---|---|
//! | sky | 40 70 120 |
//! | ground off the road | 24 40 24 |
//! | drivable surface | 84 84 92 |
//! | junction | 96 84 104 |
//! | lane surface | 106 106 114 |
//! | crosswalk | 176 168 120 |
//! | road edge | 200 96 24 |
//! | lane centre line | 64 112 140 |
//! | white line | 240 240 240 |
//! | yellow line | 240 200 40 |
//! | stop line and head, unknown | 150 150 160 |
//! | stop line and head, red | 235 30 40 |
//! | stop line and head, yellow | 255 160 0 |
//! | stop line and head, green | 30 225 90 |
//! | vehicle | 40 110 235 |
//! | pedestrian | 230 50 200 |
//! | cyclist | 170 230 50 |
//! | cone | 0 240 255 |
//! | barrier | 160 60 40 |
//! | building | 130 60 150 |
//! | vegetation | 60 150 60 |
//! | pole | 200 200 100 |
//! | fence | 80 160 170 |
//! | wall | 170 130 90 |
//!
//! The faces of a box are shades of its class: front half way to white, top a quarter, sides ¾ of the colour, rear as far beyond
//! the colour as white is before it. Of a structure's walls the first has its colour, the others ¾ of it and the colour in turn; all of it is the darker the farther away
//! it stands.

use std::collections::HashSet;
use std::sync::LazyLock;

use ds_world::{AgentClass, LightState, LineColour, StructureKind};

/// Red, green and blue in sRGB.
pub type Rgb = [u8; 3];

/// Above the horizon.
pub const SKY: Rgb = [40, 70, 120];
/// Ground off the road.
pub const GROUND: Rgb = [24, 40, 24];
/// Drivable surface.
pub const DRIVABLE: Rgb = [84, 84, 92];
/// Junction area.
pub const JUNCTION: Rgb = [96, 84, 104];
/// Lane surface.
pub const LANE: Rgb = [106, 106, 114];
/// Pedestrian crossing.
pub const CROSSWALK: Rgb = [176, 168, 120];
/// Road edge.
pub const ROAD_EDGE: Rgb = [200, 96, 24];
/// Centre line of a lane.
pub const CENTRE_LINE: Rgb = [64, 112, 140];

/// Returns the colour of a painted line.
#[must_use]
pub fn line(colour: LineColour) -> Rgb {
    match colour {
        LineColour::White => [240, 240, 240],
        LineColour::Yellow => [240, 200, 40],
    }
}

/// Returns the colour of a traffic light head and of the stop line that it governs.
#[must_use]
pub fn light(state: LightState) -> Rgb {
    match state {
        LightState::Unknown => [150, 150, 160],
        LightState::Red => [235, 30, 40],
        LightState::Yellow => [255, 160, 0],
        LightState::Green => [30, 225, 90],
    }
}

/// Returns the colour of an agent's class.
#[must_use]
pub fn agent(class: AgentClass) -> Rgb {
    match class {
        AgentClass::Vehicle => [40, 110, 235],
        AgentClass::Pedestrian => [230, 50, 200],
        AgentClass::Cyclist => [170, 230, 50],
        AgentClass::Cone => [0, 240, 255],
        AgentClass::Barrier => [160, 60, 40],
    }
}

/// Returns the colour of a kind of structure.
#[must_use]
pub fn structure(kind: StructureKind) -> Rgb {
    match kind {
        StructureKind::Building => [130, 60, 150],
        StructureKind::Vegetation => [60, 150, 60],
        StructureKind::Pole => [200, 200, 100],
        StructureKind::Fence => [80, 160, 170],
        StructureKind::Wall => [170, 130, 90],
    }
}

/// Returns a structure's colour at a share of the distance at which none is drawn any more: the farther, the darker.
#[must_use]
pub(crate) fn dimmed(colour: Rgb, away: f64) -> Rgb {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 40 to 100")]
    let percent = (100.0 - 60.0 * away).round().clamp(40.0, 100.0) as u16;
    colour.map(|c| scaled(c, percent))
}

/// The visible faces of a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Face {
    /// Facing along the heading.
    Front,
    /// Facing against the heading.
    Rear,
    /// Left or right.
    Side,
    /// Facing up.
    Top,
}

/// Returns the shade of a colour on a face.
#[must_use]
pub fn face(colour: Rgb, face: Face) -> Rgb {
    let lighter = |part: u16| colour.map(|c| blend(c, part));
    match face {
        Face::Front => lighter(2),
        Face::Top => lighter(4),
        Face::Side => colour.map(|c| scaled(c, 75)),
        Face::Rear => colour.map(|c| c.saturating_sub(255 - c)),
    }
}

/// Says whether a colour is that of a face of a vehicle, a pedestrian or a cyclist.
#[must_use]
pub fn is_road_user(colour: Rgb) -> bool {
    static SHADES: LazyLock<Vec<Rgb>> =
        LazyLock::new(|| shades([AgentClass::Vehicle, AgentClass::Pedestrian, AgentClass::Cyclist].map(agent)));
    SHADES.contains(&colour)
}

/// Says whether a colour is that of a face of a pedestrian or a cyclist.
#[must_use]
pub fn is_person(colour: Rgb) -> bool {
    static SHADES: LazyLock<Vec<Rgb>> =
        LazyLock::new(|| shades([AgentClass::Pedestrian, AgentClass::Cyclist].map(agent)));
    SHADES.contains(&colour)
}

/// Says whether a colour is that of a face of a cone or a barrier.
#[must_use]
pub fn is_obstacle(colour: Rgb) -> bool {
    static SHADES: LazyLock<Vec<Rgb>> = LazyLock::new(|| shades([AgentClass::Cone, AgentClass::Barrier].map(agent)));
    SHADES.contains(&colour)
}

/// Says whether a colour is that of paint on the road: a line or a crossing.
#[must_use]
pub fn is_marking(colour: Rgb) -> bool {
    colour == CROSSWALK || [LineColour::White, LineColour::Yellow].map(line).contains(&colour)
}

/// Says whether a colour is that of bare road: lanes, junctions and whatever else can be driven on.
#[must_use]
pub fn is_surface(colour: Rgb) -> bool {
    [DRIVABLE, JUNCTION, LANE, CENTRE_LINE].contains(&colour)
}

/// Says whether a colour tells exactly what a frame shows, in every frame anew: paint on the road, lights, people.
#[must_use]
pub fn is_told(colour: Rgb) -> bool {
    static SHADES: LazyLock<HashSet<Rgb>> = LazyLock::new(|| {
        let unknown = light(LightState::Unknown);
        let [pedestrian, cyclist] = [AgentClass::Pedestrian, AgentClass::Cyclist].map(agent);
        let paint = [CROSSWALK, line(LineColour::White), line(LineColour::Yellow)];
        let lit = [LightState::Red, LightState::Yellow, LightState::Green].map(light);
        let all = [shades([unknown, pedestrian, cyclist]), shades(lit), lit.to_vec(), paint.to_vec(), vec![unknown]];
        all.concat().into_iter().collect()
    });
    SHADES.contains(&colour)
}

/// Says whether a colour is that of a face of a light head which is red, yellow or green, or of its stop line.
#[must_use]
pub fn is_lit(colour: Rgb) -> bool {
    static SHADES: LazyLock<Vec<Rgb>> = LazyLock::new(|| {
        let lit = [LightState::Red, LightState::Yellow, LightState::Green].map(light);
        lit.into_iter().chain(shades(lit)).collect()
    });
    SHADES.contains(&colour)
}

/// Says whether a colour is that of a structure at any distance.
#[must_use]
pub fn is_structure(colour: Rgb) -> bool {
    static SHADES: LazyLock<HashSet<Rgb>> =
        LazyLock::new(|| StructureKind::ALL.map(structure).into_iter().flat_map(shades_of_structure).collect());
    SHADES.contains(&colour)
}

fn shades_of_structure(colour: Rgb) -> impl Iterator<Item = Rgb> {
    let faces = [colour, face(colour, Face::Side), face(colour, Face::Top)];
    let dims = |colour| (0..=60u8).map(move |step| dimmed(colour, f64::from(step) / 60.0));
    faces.into_iter().flat_map(dims)
}

/// Returns the shades of the faces of boxes of some colours.
fn shades<const N: usize>(colours: [Rgb; N]) -> Vec<Rgb> {
    let sides = [Face::Front, Face::Rear, Face::Side, Face::Top];
    colours.into_iter().flat_map(|colour| sides.map(|side| face(colour, side))).collect()
}

/// Goes one part in `part` of the way to white.
fn blend(value: u8, part: u16) -> u8 {
    u8::try_from(u16::from(value) + (255 - u16::from(value)) / part).unwrap_or(u8::MAX)
}

fn scaled(value: u8, percent: u16) -> u8 {
    u8::try_from(u16::from(value) * percent / 100).unwrap_or(u8::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn apart(a: Rgb, b: Rgb) -> u32 {
        a.iter().zip(b).map(|(x, y)| u32::from(x.abs_diff(y))).sum()
    }

    #[test]
    fn every_two_meanings_can_be_told_apart() {
        use AgentClass::{Barrier, Cone, Cyclist, Pedestrian, Vehicle};
        use LightState::{Green, Red, Unknown, Yellow};
        let mut all = vec![SKY, GROUND, DRIVABLE, JUNCTION, LANE, CROSSWALK, ROAD_EDGE, CENTRE_LINE];
        all.extend([LineColour::White, LineColour::Yellow].map(line));
        all.extend([Unknown, Red, Yellow, Green].map(light));
        all.extend([Vehicle, Pedestrian, Cyclist, Cone, Barrier].map(agent));
        all.extend(StructureKind::ALL.map(structure));
        for (i, a) in all.iter().enumerate() {
            assert!(all[i + 1..].iter().all(|b| apart(*a, *b) >= 24), "{a:?} is another's, too");
        }
    }

    #[test]
    fn a_box_is_told_from_what_lies_behind_it() {
        use AgentClass::{Barrier, Cone, Cyclist, Pedestrian, Vehicle};
        let behind = [SKY, GROUND, DRIVABLE, JUNCTION, LANE, CROSSWALK, ROAD_EDGE, CENTRE_LINE];
        let classes = [Vehicle, Pedestrian, Cyclist, Cone, Barrier];
        for (i, class) in classes.into_iter().enumerate() {
            let others = classes.into_iter().skip(i + 1).flat_map(|other| shades([agent(other)]));
            let lines = [LineColour::White, LineColour::Yellow].map(line);
            let all: Vec<Rgb> = behind.into_iter().chain(lines).chain(others).collect();
            for shade in shades([agent(class)]) {
                let nearest = all.iter().map(|other| apart(shade, *other)).min();
                assert!(nearest >= Some(65), "{class:?}'s {shade:?} is {nearest:?} from another");
            }
        }
    }

    #[test]
    fn road_users_and_lit_lights_are_told_from_all_else() {
        let ground = [SKY, GROUND, DRIVABLE, JUNCTION, LANE, CROSSWALK, ROAD_EDGE, CENTRE_LINE];
        let lines = [LineColour::White, LineColour::Yellow].map(line);
        let lights = [LightState::Unknown, LightState::Red, LightState::Yellow, LightState::Green].map(light);
        let cone = face(agent(AgentClass::Cone), Face::Rear);
        let standing = StructureKind::ALL.map(structure);
        let standing = || standing.into_iter().flat_map(shades_of_structure);
        assert!(!ground.into_iter().chain(lines).chain(lights).chain([cone]).chain(standing()).any(is_road_user));
        assert!(!standing().any(is_lit) && standing().all(is_structure));
        assert!(is_road_user(face(agent(AgentClass::Vehicle), Face::Rear)));
        assert!(is_road_user(face(agent(AgentClass::Pedestrian), Face::Top)));
        assert!(is_person(face(agent(AgentClass::Pedestrian), Face::Top)));
        assert!(!is_person(face(agent(AgentClass::Vehicle), Face::Rear)));
        let of_light = |state| [light(state), face(light(state), Face::Rear), face(light(state), Face::Front)];
        assert!([LightState::Red, LightState::Yellow, LightState::Green].into_iter().flat_map(of_light).all(is_lit));
        assert!(!ground.into_iter().chain(lines).chain(of_light(LightState::Unknown)).any(is_lit));
        let users = [AgentClass::Vehicle, AgentClass::Pedestrian, AgentClass::Cyclist].map(agent);
        assert!(!shades(users).into_iter().any(is_lit));
    }

    #[test]
    fn the_table_in_the_docs_is_this_table() {
        let docs = include_str!("../../../../docs/layout-colours.md");
        for row in include_str!("colour.rs").lines().filter_map(|line| line.strip_prefix("//! | ")) {
            assert!(docs.contains(row), "docs/layout-colours.md lacks the row {row:?}");
        }
    }
}
