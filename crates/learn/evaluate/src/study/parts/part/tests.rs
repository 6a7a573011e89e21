//! Colours tell of parts, and parts of real layouts cover each pixel once.

use std::collections::BTreeSet;
use std::sync::Arc;

use ds_camera::{Appearance, ReferenceWorld};
use ds_layout::colour::Face;
use ds_scenario::Family;
use ds_world::{AgentClass, LightState, LineColour, StructureKind};

use super::*;
use crate::drive::{Drive, Route};

/// Layouts of every family.
fn layouts() -> impl Iterator<Item = RgbImage> {
    Family::ALL.into_iter().map(|family| {
        let scene = Arc::new(ds_scenario::generate(family, 30_000_100));
        let route = Route { scene, start: 0, pace: 1.0, look: Appearance::DAY, turned_deg: 0.0 };
        let mut drive = Drive::new(&ReferenceWorld, &route, (160, 96)).expect("there is a camera");
        drive.layout(40).expect("a layout").image
    })
}

#[test]
fn parts_pasted_one_after_the_other_cover_each_pixel_once() {
    let mut met = BTreeSet::new();
    for layout in layouts() {
        let parts = of(&layout);
        assert_eq!(parts.len(), layout.rgb().len() / 3);
        assert!((shares(&parts).iter().sum::<f64>() - 1.0).abs() < 1e-9);
        let [dark, bright] = [[10; 3], [200; 3]].map(|level| RgbImage::filled(160, 96, level));
        let mut times = vec![0; parts.len()];
        let mut whole = dark.clone();
        for part in Part::ALL {
            let alone = pasted(&dark, &bright, &parts, part);
            for (times, pixel) in times.iter_mut().zip(alone.rgb().chunks_exact(3)) {
                *times += u32::from(pixel == [200; 3]);
            }
            whole = pasted(&whole, &bright, &parts, part);
        }
        assert!(times.iter().all(|times| *times == 1) && whole == bright);
        met.extend(parts);
    }
    assert!(met.len() >= 8, "{met:?}");
}

#[test]
fn colours_tell_of_parts() {
    let faces = [Face::Front, Face::Rear, Face::Side, Face::Top];
    let of_class = |class| faces.map(|face| colour::face(colour::agent(class), face)).to_vec();
    let lights = [LightState::Unknown, LightState::Red, LightState::Yellow, LightState::Green].map(colour::light);
    let heads = lights.into_iter().flat_map(|light| faces.map(|face| colour::face(light, face)));
    let lights: Vec<Rgb> = lights.into_iter().chain(heads).collect();
    for (part, colours) in [
        (Part::People, [AgentClass::Pedestrian, AgentClass::Cyclist].map(of_class).concat()),
        (Part::Vehicles, of_class(AgentClass::Vehicle)),
        (Part::Cones, [AgentClass::Cone, AgentClass::Barrier].map(of_class).concat()),
        (Part::Paint, [colour::CROSSWALK, colour::line(LineColour::White), colour::line(LineColour::Yellow)].to_vec()),
        (Part::Structures, StructureKind::ALL.map(colour::structure).to_vec()),
        (Part::Lights, lights.clone()),
        (Part::Surface, [colour::LANE, colour::JUNCTION, colour::DRIVABLE, colour::CENTRE_LINE].to_vec()),
        (Part::Edge, vec![colour::ROAD_EDGE]),
    ] {
        assert!(colours.iter().all(|colour| Part::told(*colour) == part), "{part:?}: {colours:?}");
    }
    // Nothing else falls to the lights.
    for layout in layouts() {
        let colours: BTreeSet<Rgb> = layout.rgb().as_chunks().0.iter().copied().collect();
        let strange: Vec<&Rgb> =
            colours.iter().filter(|colour| Part::told(**colour) == Part::Lights && !lights.contains(colour)).collect();
        assert!(strange.is_empty(), "{strange:?}");
    }
}

#[test]
fn people_and_vehicles_have_a_border() {
    use Part::{Paint, People, Surface, Vehicles};
    let mut layout = RgbImage::filled(5, 3, colour::LANE);
    layout.set_pixel(1, 1, colour::face(colour::agent(AgentClass::Vehicle), Face::Rear));
    layout.set_pixel(3, 1, colour::face(colour::agent(AgentClass::Pedestrian), Face::Rear));
    layout.set_pixel(4, 0, colour::line(LineColour::White));
    #[rustfmt::skip]
    assert_eq!(of(&layout), [
        Surface, Vehicles, Surface, People, Paint,
        Vehicles, Vehicles, People, People, People,
        Surface, Vehicles, Surface, People, Surface,
    ]);
}
