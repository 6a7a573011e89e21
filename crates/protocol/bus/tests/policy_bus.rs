//! The outside bus: a guest drives a session; another that listens to everything and writes everywhere learns and
//! changes nothing.

use std::time::Duration;

use ds_bus::{FromBridge, FromPolicy, PolicyBus, PolicyBusSettings, PolicyGuest};
use ds_raster::{Encoding, RgbImage};
use ds_space::{CameraId, CameraModel, DVec3, InstanceId, Intrinsics, PoseSe2, SimTime};
use ds_topic::Plan;
use ds_wire::policy::{
    CameraView, Observation, PolicyHello, PolicyPlan, SessionGoodbye, SessionHello, StampedEgo, StampedImage,
};
use ds_world::{EgoState, RouteCommand, Trajectory, TrajectoryPoint};

const LIMIT: Duration = Duration::from_secs(20);
const QUIET: Duration = Duration::from_millis(500);

fn name(text: &str) -> InstanceId {
    InstanceId::new(text).expect("an id")
}

async fn bridge() -> PolicyBus {
    let listen = vec!["tcp/127.0.0.1:0".to_owned()];
    let settings = PolicyBusSettings { policy: name("team-a"), listen, connect: vec![], tls: None };
    PolicyBus::open(&settings).await.expect("opens")
}

fn camera() -> CameraModel {
    let id = CameraId::new("front").expect("an id");
    CameraModel::mounted(id, Intrinsics::centred(160, 96, 1.2), DVec3::new(1.5, 0.0, 1.6), 0.0, 0.05)
}

fn observation(sequence: u64) -> Observation {
    let image = RgbImage::filled(160, 96, [1, 2, 3]);
    let time = SimTime(500_000_000 * sequence as i64);
    Observation {
        sequence,
        time,
        cameras: vec![CameraView { camera: camera(), images: vec![StampedImage { time, image }] }],
        ego: vec![StampedEgo { time, state: EgoState::default() }],
        command: RouteCommand::Left,
        horizon: SimTime(8_000_000_000),
        step: SimTime(100_000_000),
        deadline_millis: 1_000,
        encoding: Encoding::Png,
    }
}

fn plan(for_sequence: u64) -> PolicyPlan {
    let point = TrajectoryPoint { after: SimTime(500_000_000), pose: PoseSe2::new(5.0, 0.0, 0.0) };
    let trajectory = Trajectory::new(vec![point]).expect("sound");
    PolicyPlan {
        for_sequence,
        plan: Plan { trajectory, proposals: vec![], observed: None, answered: None, context: None },
    }
}

fn hello() -> FromBridge {
    FromBridge::Hello(SessionHello {
        cameras: vec![camera()],
        history: 1,
        horizon: SimTime(8_000_000_000),
        step: SimTime(100_000_000),
        deadline_millis: 1_000,
    })
}

/// Drives a guest that answers everything; ends at goodbye and returns the number of observations.
async fn drive(mut guest: PolicyGuest) -> u64 {
    let mut seen = 0;
    loop {
        let (session, message) = guest.recv().await.expect("the bridge speaks soundly");
        let answer = match message {
            FromBridge::Hello(_) => FromPolicy::Ready(PolicyHello { name: "ten-lines 1".to_owned() }),
            FromBridge::Observation(observation) => {
                seen += 1;
                FromPolicy::Plan(plan(observation.sequence))
            }
            FromBridge::Goodbye(_) => return seen,
        };
        guest.put(&session, &answer).await.expect("puts");
    }
}

/// Repeats a question until the wanted answer comes.
async fn ask(session: &mut ds_bus::PolicySession, question: &FromBridge, wanted: impl Fn(&FromPolicy) -> bool) {
    let repeat = async {
        loop {
            session.put(question).await.expect("puts");
            while let Ok(answer) = tokio::time::timeout(QUIET, session.recv()).await {
                if wanted(&answer.expect("the guest answers soundly")) {
                    return;
                }
            }
        }
    };
    tokio::time::timeout(LIMIT, repeat).await.expect("the guest answers within the limit");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_guest_drives_a_session_over_tcp() {
    let bus = bridge().await;
    let guest = PolicyGuest::connect(&name("team-a"), &bus.listens()[0], None).await.expect("connects");
    let driver = tokio::spawn(drive(guest));
    let mut session = bus.begin().await.expect("begins");
    ask(&mut session, &hello(), |answer| matches!(answer, FromPolicy::Ready(_))).await;
    for sequence in 0..3 {
        let question = FromBridge::Observation(Box::new(observation(sequence)));
        ask(&mut session, &question, |answer| *answer == FromPolicy::Plan(plan(sequence))).await;
    }
    let goodbye = FromBridge::Goodbye(SessionGoodbye { reason: "completed".to_owned() });
    session.put(&goodbye).await.expect("puts");
    let seen = tokio::time::timeout(LIMIT, driver).await.expect("ends").expect("does not panic");
    assert!(seen >= 3, "{seen} observations");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_eavesdropper_learns_and_changes_nothing() {
    let bus = bridge().await;
    let mut session = bus.begin().await.expect("begins");
    let driver =
        tokio::spawn(drive(PolicyGuest::connect(&name("team-a"), &bus.listens()[0], None).await.expect("connects")));
    // A guest of another policy may connect, but sees and reaches nothing, even with the session's name.
    let mut stranger = PolicyGuest::connect(&name("team-b"), &bus.listens()[0], None).await.expect("connects");
    stranger.put(session.name(), &FromPolicy::Plan(plan(77))).await.expect("puts");
    let raw = raw_client(&bus.listens()[0]).await;
    let remote = zenoh::sample::Locality::Remote;
    let heard = raw.declare_subscriber("**").allowed_origin(remote).await.expect("declares");
    let forged = format!("dreamstream-policy/v1/team-a/{}/observation", session.name());
    for key in ["dreamstream/v1/e1/advance", "dreamstream-policy/v1/team-a/x/plan", &forged] {
        raw.put(key, vec![0_u8; 50]).await.expect("puts");
    }
    ask(&mut session, &hello(), |answer| matches!(answer, FromPolicy::Ready(_))).await;
    let question = FromBridge::Observation(Box::new(observation(0)));
    ask(&mut session, &question, |answer| {
        assert_ne!(*answer, FromPolicy::Plan(plan(77)), "a stranger's plan arrived");
        *answer == FromPolicy::Plan(plan(0))
    })
    .await;
    assert!(tokio::time::timeout(QUIET, stranger.recv()).await.is_err(), "the stranger heard something");
    let queried = raw.get("**").timeout(QUIET).await.expect("queries");
    assert!(queried.recv_async().await.is_err(), "a query was answered");
    assert!(heard.try_recv().expect("open").is_none(), "the eavesdropper heard something");
    driver.abort();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn bad_answers_come_as_errors_and_the_session_goes_on() {
    let bus = bridge().await;
    let mut session = bus.begin().await.expect("begins");
    let raw = raw_client(&bus.listens()[0]).await;
    let key = format!("dreamstream-policy/v1/team-a/{}/plan", session.name());
    for (payload, says) in [(vec![0xff_u8; 40], "plan cannot be decoded"), (vec![], "plan is refused")] {
        let error = async {
            loop {
                raw.put(&key, payload.clone()).await.expect("puts");
                if let Ok(answer) = tokio::time::timeout(QUIET, session.recv()).await {
                    let text = answer.expect_err("refused").to_string();
                    if text.contains(says) {
                        return;
                    }
                }
            }
        };
        tokio::time::timeout(LIMIT, error).await.unwrap_or_else(|_| panic!("no error says {says:?}"));
    }
    while tokio::time::timeout(QUIET, session.recv()).await.is_ok() {}
    raw.put(&key, vec![0_u8; 3 << 20]).await.expect("puts");
    assert!(tokio::time::timeout(QUIET, session.recv()).await.is_err(), "an oversized answer passed the link");
}

async fn raw_client(endpoint: &str) -> zenoh::Session {
    let mut config = zenoh::Config::default();
    let endpoints = format!("[{endpoint:?}]");
    for (key, value) in [
        ("mode", "\"client\""),
        ("connect/endpoints", endpoints.as_str()),
        ("listen/endpoints", "[]"),
        ("scouting/multicast/enabled", "false"),
    ] {
        config.insert_json5(key, value).expect("a setting");
    }
    zenoh::open(config).await.expect("connects")
}
