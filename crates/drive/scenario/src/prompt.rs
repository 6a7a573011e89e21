//! The prompt of a drive, written from its facts by a template; training clips and runs have theirs from here.
//!
//! Embeddings may be bags of words (`ds_video::prompt::hashed`), so each thing has words of its own that stand for
//! nothing else in the template, and a count is in the word: "lone car", "few cars", "dense traffic".

use crate::facts::{Ahead, EgoMotion, Facts, Geometry};

/// Writes the prompt.
#[must_use]
pub fn prompt(facts: &Facts) -> String {
    let mut words = vec![facts.appearance.clone()];
    words.push(
        match facts.road {
            Geometry::Straight => "straight street",
            Geometry::CurveLeft => "street curves left",
            Geometry::CurveRight => "street curves right",
            Geometry::Intersection => "intersection",
            Geometry::Roundabout => "roundabout",
        }
        .to_owned(),
    );
    words.push(
        match facts.lanes {
            0 | 1 => "single lane",
            2 => "double lane",
            _ => "multiple lane",
        }
        .to_owned(),
    );
    if let Some(light) = &facts.traffic_light {
        words.push(match light.as_str() {
            "unknown" => "traffic signal".to_owned(),
            state => format!("{state} traffic signal"),
        });
    }
    if facts.crosswalk {
        words.push("crosswalk".to_owned());
    }
    words.push(
        match facts.vehicles.all() {
            0 => "empty of cars",
            1 => "lone car",
            2..=4 => "few cars",
            _ => "dense cars",
        }
        .to_owned(),
    );
    if facts.vehicles.standing > 0 {
        words.push("parked or waiting vehicles".to_owned());
    }
    if facts.oncoming > 0 {
        words.push("oncoming vehicles".to_owned());
    }
    if let Some(leader_m) = facts.leader_m {
        let near = if leader_m < 20.0 { "close leader" } else { "distant leader" };
        words.push(if facts.leader_slower { format!("{near} slowing") } else { near.to_owned() });
    }
    people(&mut words, &facts.pedestrians, ["pedestrian walking", "pedestrians walking", "pedestrian waits"]);
    people(&mut words, &facts.cyclists, ["cyclist riding", "cyclists riding", "cyclist stopped"]);
    if facts.obstacles > 0 {
        words.push("cones or barriers".to_owned());
    }
    words.push(
        match facts.ego {
            EgoMotion::Standing => "ego stands",
            EgoMotion::Braking => "ego brakes",
            EgoMotion::Accelerating => "ego accelerates",
            EgoMotion::Cruising if facts.ego_speed_mps < 4.0 => "ego creeps",
            EgoMotion::Cruising if facts.ego_speed_mps < 9.0 => "ego cruises",
            EgoMotion::Cruising => "ego hurries",
        }
        .to_owned(),
    );
    match facts.ego_turn_rad {
        turn if turn > 0.12 => words.push("turning leftward".to_owned()),
        turn if turn < -0.12 => words.push("turning rightward".to_owned()),
        _ => {}
    }
    words.join(", ")
}

fn people(words: &mut Vec<String>, seen: &Ahead, [one, many, still]: [&str; 3]) {
    match seen.moving {
        0 => {}
        1 => words.push(one.to_owned()),
        _ => words.push(many.to_owned()),
    }
    if seen.standing > 0 {
        words.push(still.to_owned());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts() -> Facts {
        Facts {
            appearance: "driving by day, clear sky, dry road".to_owned(),
            road: Geometry::Straight,
            lanes: 1,
            traffic_light: None,
            crosswalk: false,
            vehicles: Ahead::default(),
            oncoming: 0,
            leader_m: None,
            leader_slower: false,
            pedestrians: Ahead::default(),
            cyclists: Ahead::default(),
            obstacles: 0,
            ego: EgoMotion::Cruising,
            ego_speed_mps: 8.0,
            ego_turn_rad: 0.0,
        }
    }

    #[test]
    fn prompts_tell_the_facts() {
        let check = |change: &dyn Fn(&mut Facts), expected: &str| {
            let mut facts = facts();
            change(&mut facts);
            assert_eq!(prompt(&facts), expected);
        };
        check(&|_| (), "driving by day, clear sky, dry road, straight street, single lane, empty of cars, ego cruises");
        check(
            &|facts| {
                facts.road = Geometry::Intersection;
                facts.lanes = 2;
                facts.traffic_light = Some("red".to_owned());
                facts.crosswalk = true;
                facts.vehicles = Ahead { moving: 2, standing: 1 };
                facts.oncoming = 1;
                facts.leader_m = Some(12.0);
                facts.leader_slower = true;
                facts.pedestrians = Ahead { moving: 1, standing: 1 };
                facts.cyclists = Ahead { moving: 3, standing: 0 };
                facts.ego = EgoMotion::Braking;
                facts.ego_turn_rad = 0.3;
            },
            "driving by day, clear sky, dry road, intersection, double lane, red traffic signal, crosswalk, few cars, \
             parked or waiting vehicles, oncoming vehicles, close leader slowing, pedestrian walking, pedestrian waits, \
             cyclists riding, ego brakes, turning leftward",
        );
    }
}
