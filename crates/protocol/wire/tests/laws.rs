//! Laws of the wire: what was written is read back bit for bit, the digest can be computed again, headers and bodies
//! part and join.

#[path = "laws/values.rs"]
mod values;

use ds_space::{AttemptId, DVec2, Digest, EpisodeId, InstanceId, PoseSe2, SimTime, Tick};
use ds_topic::{
    Advance, Cache, Diagnosis, Ego, Envelope, Event, EventKind, Frame, Header, Layout, Plan, SCHEMA_VERSION,
    SceneMessage, Score, Slot, Topic, World,
};
use ds_wire::policy::{Observation, PolicyMessage, PolicyPlan, SessionHello};
use ds_wire::{Body, encode, message_name, split, v1, verify};
use ds_world::{Trajectory, TrajectoryPoint};
use proptest::prelude::*;
use prost::Message;

fn header<B: Body>(body: &B, camera: u16) -> Header {
    let camera = if B::TOPIC.per_camera() { camera } else { 0 };
    Header {
        episode: EpisodeId::new("scene-0061.s3").expect("an id"),
        attempt: AttemptId(2),
        term: 3,
        epoch: 4,
        iteration: 5,
        tick: Tick(6),
        time: SimTime(600_000_000),
        sequence: 7,
        publisher: InstanceId::new("sim-1").expect("an id"),
        schema_version: SCHEMA_VERSION,
        trace: "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01".to_owned(),
        slot: Slot { topic: B::TOPIC, index: 8, camera },
        content: body.content(),
    }
}

/// Reads a message whose header says nothing of its content.
fn undigested(envelope: &Envelope) -> Envelope {
    let mut header = v1::Header::from(&envelope.header);
    header.content.clear();
    let mut message = vec![0x0a];
    prost::encoding::encode_varint(header.encoded_len() as u64, &mut message);
    message.extend(header.encode_to_vec());
    message.extend_from_slice(&envelope.body);
    split(message.into()).expect("a message without a digest is read")
}

fn check<B: Body + PartialEq + std::fmt::Debug>(body: &B) -> Result<(), TestCaseError> {
    let bytes = body.to_bytes();
    let again = B::from_bytes(&bytes).map_err(|error| TestCaseError::fail(error.to_string()))?;
    prop_assert_eq!(&again, body);
    prop_assert_eq!(again.content(), body.content());
    prop_assert_eq!(again.to_bytes(), bytes.clone());
    let envelope = Envelope { header: header(body, 1), body: bytes };
    let message = encode(&envelope.header, &envelope.body);
    let parted = split(message.clone()).map_err(|error| TestCaseError::fail(error.to_string()))?;
    prop_assert_eq!(&parted, &envelope);
    prop_assert_eq!(&undigested(&envelope), &envelope, "the digest that its header leaves out");
    let range = message.as_ptr_range();
    prop_assert!(parted.body.is_empty() || range.contains(&parted.body.as_ptr()), "the body was copied");
    prop_assert!(verify::<B>(&parted).is_ok());
    let mut other = parted;
    other.header.content = Digest([9; 32]);
    prop_assert!(verify::<B>(&other).is_err());
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn world_is_read_as_written(body in values::world()) { check::<World>(&body)?; }

    #[test]
    fn ego_is_read_as_written(body in values::ego()) { check::<Ego>(&body)?; }

    #[test]
    fn layout_is_read_as_written(body in values::layout()) { check::<Layout>(&body)?; }

    #[test]
    fn frame_is_read_as_written(body in values::frame()) { check::<Frame>(&body)?; }

    #[test]
    fn plan_is_read_as_written(body in values::plan()) { check::<Plan>(&body)?; }

    #[test]
    fn cache_is_read_as_written(body in values::cache()) { check::<Cache>(&body)?; }

    #[test]
    fn score_is_read_as_written(body in values::score()) { check::<Score>(&body)?; }

    #[test]
    fn diagnosis_is_read_as_written(body in values::diagnosis()) { check::<Diagnosis>(&body)?; }

    #[test]
    fn advance_is_read_as_written(body in values::advance()) { check::<Advance>(&body)?; }

    #[test]
    fn scene_is_read_as_written(body in values::scene()) { check::<SceneMessage>(&body)?; }

    #[test]
    fn an_observation_is_read_as_written(seen in values::observation()) {
        let again = Observation::from_bytes(&seen.to_bytes());
        prop_assert_eq!(again, Ok(seen));
    }

    #[test]
    fn an_answer_is_read_as_written(plan in values::plan(), for_sequence: u64) {
        // when the frames were observed is the bridge's to say, not the policy's
        let answer = PolicyPlan { for_sequence, plan: Plan { observed: None, answered: None, ..plan } };
        prop_assert_eq!(PolicyPlan::from_bytes(&answer.to_bytes()), Ok(answer));
    }

    #[test]
    fn a_hello_is_read_as_written(cameras in prop::collection::vec(values::camera(), 1..3), history in 1_u32..9) {
        let hello = SessionHello {
            cameras, history, horizon: SimTime(8_000_000_000), step: SimTime(100_000_000), deadline_millis: 1_000,
        };
        prop_assert_eq!(SessionHello::from_bytes(&hello.to_bytes()), Ok(hello));
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = split(bytes.clone().into());
        let _ = SceneMessage::from_bytes(&bytes);
        let _ = World::from_bytes(&bytes);
        let _ = Cache::from_bytes(&bytes);
        let _ = Diagnosis::from_bytes(&bytes);
        let _ = PolicyPlan::from_bytes(&bytes);
    }
}

#[test]
fn headings_of_a_guests_plan_are_as_given() {
    let given = PoseSe2 { position: DVec2::new(4.0, 1.0), heading_rad: 57.3 };
    let trajectory =
        Trajectory::new(vec![TrajectoryPoint { after: SimTime(500_000_000), pose: given }]).expect("a plan");
    let plan = Plan { trajectory, proposals: Vec::new(), observed: None, answered: None, context: None };
    let read = PolicyPlan::from_bytes(&PolicyPlan { for_sequence: 0, plan }.to_bytes()).expect("read");
    assert_eq!(read.plan.trajectory.points()[0].pose, given, "wrapped, it would hide that it is in degrees");
}

#[test]
fn every_kind_of_event_is_read_as_written() {
    for kind in [
        EventKind::Started,
        EventKind::Completed,
        EventKind::Failed,
        EventKind::Aborted,
        EventKind::Fault,
        EventKind::Reassigned,
    ] {
        let event = Event { kind, reason: "policy_deadline: 800 ms".to_owned() };
        check(&event).expect("reads back");
    }
}

#[test]
fn the_descriptor_set_names_every_topic() {
    let text = String::from_utf8_lossy(ds_wire::DESCRIPTOR_SET);
    for topic in Topic::ALL {
        let name = message_name(topic).rsplit('.').next().expect("a name has a last part");
        assert!(text.contains(name), "{name} is not in the descriptor set");
    }
}
