//! The bus as it is: two sessions over TCP on this host, and one embedded session. Waits are for conditions with a limit.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bytes::Bytes;
use ds_bus::{BusSession, BusSettings, Holder, topics_of};
use ds_space::{AttemptId, Digest, EpisodeId, InstanceId, SimTime, Tick};
use ds_topic::{Envelope, Header, Role, SCHEMA_VERSION, Slot, Topic};

const LIMIT: Duration = Duration::from_secs(20);
const PULL: Duration = Duration::from_secs(2);

fn episode() -> EpisodeId {
    EpisodeId::new("e1").expect("an id")
}

fn publisher() -> InstanceId {
    InstanceId::new("video-1").expect("an id")
}

fn message(slot: Slot, bytes: usize) -> Envelope {
    let body: Bytes = (0..bytes).map(|at| (at as u32).wrapping_mul(slot.index + 7) as u8).collect::<Vec<u8>>().into();
    let header = Header {
        episode: episode(),
        attempt: AttemptId(1),
        term: 1,
        epoch: 1,
        iteration: 0,
        tick: Tick(slot.index),
        time: SimTime(0),
        sequence: u64::from(slot.index),
        publisher: publisher(),
        schema_version: SCHEMA_VERSION,
        trace: String::new(),
        slot,
        content: Digest::of(&body),
    };
    Envelope { header, body }
}

fn frame(index: u32) -> Slot {
    Slot::of_camera(Topic::Frame, index, 0)
}

/// Two sessions joined by TCP; the first has the losses that the settings ask for.
async fn pair(sender: BusSettings) -> (BusSession, BusSession) {
    let listen = vec!["tcp/127.0.0.1:0".to_owned()];
    let first = BusSession::open(&BusSettings { listen, ..sender }).await.expect("opens");
    let connect = first.listens().to_vec();
    let second = BusSession::open(&BusSettings { connect, ..BusSettings::default() }).await.expect("connects");
    (first, second)
}

/// Answers every query with a message of `bytes` bytes for slots below `count`, until dropped.
async fn serve(session: &BusSession, count: u32, bytes: usize) -> tokio::task::JoinHandle<()> {
    let mut asks = session.serve_pulls(&Holder::Instance(publisher()), &episode()).await.expect("declares");
    tokio::spawn(async move {
        loop {
            let ask = asks.recv().await;
            let found = (ask.slot.index < count).then(|| message(ask.slot, bytes));
            ask.answer(found.as_ref()).await.expect("answers");
        }
    })
}

/// Pulls until the holder is known on this side and has the message.
async fn pull(session: &BusSession, slot: Slot) -> Envelope {
    let ask = async {
        loop {
            let from = Holder::Instance(publisher());
            if let Some(found) = session.pull(&episode(), &from, slot, PULL).await.expect("pulls") {
                return found;
            }
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(LIMIT, ask).await.expect("the holder answers within the limit")
}

/// Repeats a push until the other side has seen it: subscriptions take a moment to become known.
async fn warm(sender: &BusSession, receiver: &mut ds_bus::Subscription) {
    let slot = Slot::new(Topic::Scene, 0);
    let push = async {
        loop {
            sender.publish(&message(slot, 1)).await.expect("publishes");
            if tokio::time::timeout(Duration::from_millis(50), receiver.recv()).await.is_ok() {
                return;
            }
        }
    };
    tokio::time::timeout(LIMIT, push).await.expect("the subscription is known within the limit");
    while tokio::time::timeout(Duration::from_millis(100), receiver.recv()).await.is_ok() {}
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_pushed_arrives_whole_whatever_its_order_and_size() {
    let (sender, receiver) = pair(BusSettings::default()).await;
    let mut subscription = receiver.subscribe(&episode(), topics_of(Role::Policy)).await.expect("subscribes");
    warm(&sender, &mut subscription).await;
    let mut sent = BTreeSet::new();
    for (index, bytes) in [0, 100, 46_080, 65_536, 1_200_000].into_iter().enumerate() {
        let slot = frame(index as u32);
        sender.publish(&message(slot, bytes)).await.expect("publishes");
        sent.insert((slot, bytes));
    }
    let mut got = BTreeSet::new();
    while got.len() < sent.len() {
        let found = tokio::time::timeout(LIMIT, subscription.recv()).await.expect("arrives");
        assert_eq!(found, message(found.header.slot, found.body.len()));
        got.insert((found.header.slot, found.body.len()));
    }
    assert_eq!(got, sent);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn with_all_pushes_dropped_pulls_bring_everything() {
    let (sender, receiver) = pair(BusSettings { drop_pushes: true, ..BusSettings::default() }).await;
    let mut subscription = receiver.subscribe(&episode(), &[Topic::Frame]).await.expect("subscribes");
    let server = serve(&sender, 20, 1_200_000).await;
    for index in 0..20 {
        sender.publish(&message(frame(index), 10)).await.expect("a dropped push is no error");
        assert_eq!(pull(&receiver, frame(index)).await, message(frame(index), 1_200_000));
    }
    assert_eq!(subscription.try_recv(), None);
    assert_eq!(sender.counters().snapshot()["withheld_pushes"], 20);
    let none = receiver.pull(&episode(), &Holder::Instance(publisher()), frame(99), PULL).await.expect("pulls");
    assert_eq!(none, None);
    let nobody = receiver.pull(&episode(), &Holder::Journal, frame(0), PULL).await.expect("pulls");
    assert_eq!(nobody, None);
    server.abort();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_share_of_pushes_is_dropped_by_seed() {
    let settings = BusSettings { drop_share: 0.3, drop_seed: 5, ..BusSettings::default() };
    let mut withheld = Vec::new();
    for _ in 0..2 {
        let session = BusSession::open(&settings).await.expect("opens");
        for index in 0..200 {
            session.publish(&message(frame(index), 1)).await.expect("publishes");
        }
        withheld.push(session.counters().snapshot()["withheld_pushes"]);
    }
    assert_eq!(withheld[0], withheld[1]);
    assert!((30..90).contains(&withheld[0]), "{withheld:?} of 200");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_receiver_that_stops_reading_loses_nothing_by_pulling() {
    let (sender, receiver) = pair(BusSettings::default()).await;
    let narrow = BusSettings { queue: 4, connect: sender.listens().to_vec(), ..BusSettings::default() };
    receiver.close().await.expect("closes");
    let receiver = BusSession::open(&narrow).await.expect("connects");
    let mut subscription = receiver.subscribe(&episode(), topics_of(Role::Policy)).await.expect("subscribes");
    let server = serve(&sender, 60, 46_080).await;
    warm(&sender, &mut subscription).await;
    // Nobody reads while sixty frames are pushed: the queue keeps four.
    for index in 0..60 {
        sender.publish(&message(frame(index), 46_080)).await.expect("a stopped receiver does not stop the sender");
    }
    let all_came = async {
        while receiver.counters().snapshot()["dropped"] < 56 {
            tokio::task::yield_now().await;
        }
    };
    // Pushes may also be lost on the way; then the rest stays fewer, and the limit below ends the wait.
    let _ = tokio::time::timeout(Duration::from_secs(3), all_came).await;
    let mut got = BTreeSet::new();
    while let Some(found) = subscription.try_recv() {
        got.insert(found.header.slot.index);
    }
    assert!(got.len() <= 4, "the queue kept {} frames", got.len());
    for index in 0..60 {
        if !got.contains(&index) {
            assert_eq!(pull(&receiver, frame(index)).await, message(frame(index), 46_080));
            got.insert(index);
        }
    }
    assert_eq!(got.len(), 60);
    server.abort();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_embedded_session_serves_all_roles_and_episodes_stay_apart() {
    let session = BusSession::embedded().await.expect("opens");
    let other = EpisodeId::new("e2").expect("an id");
    let mut mine = session.subscribe(&episode(), &[Topic::Frame, Topic::World]).await.expect("subscribes");
    let mut theirs = session.subscribe(&other, &[Topic::Frame, Topic::World]).await.expect("subscribes");
    let server = serve(&session, 3, 50).await;
    session.publish(&message(Slot::new(Topic::World, 1), 30)).await.expect("publishes");
    session.publish(&message(frame(1), 40)).await.expect("publishes");
    assert_eq!(
        tokio::time::timeout(LIMIT, mine.recv()).await.expect("arrives").header.slot,
        Slot::new(Topic::World, 1)
    );
    assert_eq!(tokio::time::timeout(LIMIT, mine.recv()).await.expect("arrives").header.slot, frame(1));
    assert_eq!(theirs.try_recv(), None);
    assert_eq!(pull(&session, frame(2)).await.body.len(), 50);
    server.abort();
    drop(mine);
    session.publish(&message(frame(2), 40)).await.expect("publishes");
    assert_eq!(session.counters().snapshot()["received"], 2, "a dropped subscription still received");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_later_order_answers_a_pull_of_an_earlier_one_and_nothing_else_does() {
    let session = BusSession::embedded().await.expect("opens");
    let mut asks = session.serve_pulls(&Holder::Journal, &episode()).await.expect("declares");
    let server = tokio::spawn(async move {
        loop {
            let ask = asks.recv().await;
            let later = Slot { index: ask.slot.index + 2, ..ask.slot };
            ask.answer(Some(&message(later, 5))).await.expect("answers");
        }
    });
    let ask = |slot| {
        let session = session.clone();
        async move { session.pull(&episode(), &Holder::Journal, slot, PULL).await.expect("pulls") }
    };
    let found = ask(Slot::new(Topic::Advance, 3)).await.expect("a later order is an answer");
    assert_eq!(found.header.slot.index, 5);
    assert_eq!(ask(Slot::new(Topic::World, 3)).await, None);
    server.abort();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn liveliness_tells_of_comings_and_goings() {
    let (first, second) = pair(BusSettings::default()).await;
    let token = first.declare_alive(&publisher()).await.expect("declares");
    let mut watch = second.watch_alive().await.expect("watches");
    let came = tokio::time::timeout(LIMIT, watch.recv()).await.expect("tells");
    assert_eq!(came, (publisher(), true));
    drop(token);
    let went = tokio::time::timeout(LIMIT, watch.recv()).await.expect("tells");
    assert_eq!(went, (publisher(), false));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_dropped_future_of_recv_loses_nothing() {
    let session = BusSession::embedded().await.expect("opens");
    let mut subscription = session.subscribe(&episode(), &[Topic::Frame]).await.expect("subscribes");
    let cancelled = AtomicBool::new(false);
    tokio::select! {
        biased;
        () = async { cancelled.store(true, Ordering::Relaxed) } => {}
        _ = subscription.recv() => {}
    }
    assert!(cancelled.load(Ordering::Relaxed));
    session.publish(&message(frame(7), 3)).await.expect("publishes");
    assert_eq!(tokio::time::timeout(LIMIT, subscription.recv()).await.expect("arrives").header.slot, frame(7));
}
