//! `collision_type/1`: pairs of an ego (rear axle, speed along its heading) and an object → the kind of collision.

use ds_score::{CollisionType, Footprint, ObjectClass};
use ds_space::PoseSe2;
use ds_space::plane::OrientedBox;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::agents::class_of;
use crate::error::ScoreCaseError;

#[derive(Deserialize)]
pub(crate) struct Case {
    pairs: Vec<Pair>,
}

#[derive(Deserialize)]
struct Pair {
    ego: Ego,
    object: Object,
}

#[derive(Deserialize)]
struct Ego {
    x: f64,
    y: f64,
    heading: f64,
    speed: f64,
}

#[derive(Deserialize)]
struct Object {
    #[serde(rename = "type")]
    kind: String,
    x: f64,
    y: f64,
    heading: f64,
    length: f64,
    width: f64,
    speed: f64,
}

pub(crate) fn answer(case: &Case) -> Result<Value, ScoreCaseError> {
    let mut pairs = Vec::with_capacity(case.pairs.len());
    for (index, Pair { ego, object }) in case.pairs.iter().enumerate() {
        let class = class_of(&object.kind, || format!("pairs[{index}].object.type"))?;
        let rear_axle = PoseSe2::new(ego.x, ego.y, ego.heading);
        let other = OrientedBox::new(&PoseSe2::new(object.x, object.y, object.heading), object.length, object.width);
        let stopped = class == ObjectClass::Static || object.speed.abs() <= ds_score::constants::navsim::STOPPED_MPS;
        let footprint = Footprint::NAVSIM.at(&rear_axle);
        let kind = CollisionType::of(&footprint, rear_axle.position, ego.speed.abs(), &other, stopped);
        pairs.push(json!({ "expected": name(kind) }));
    }
    Ok(json!({ "pairs": pairs }))
}

fn name(kind: CollisionType) -> &'static str {
    match kind {
        CollisionType::StoppedEgo => "STOPPED_EGO_COLLISION",
        CollisionType::StoppedTrack => "STOPPED_TRACK_COLLISION",
        CollisionType::ActiveRear => "ACTIVE_REAR_COLLISION",
        CollisionType::ActiveFront => "ACTIVE_FRONT_COLLISION",
        CollisionType::ActiveLateral => "ACTIVE_LATERAL_COLLISION",
    }
}
