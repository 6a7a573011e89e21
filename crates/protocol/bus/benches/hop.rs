//! One hop over the bus: the ratio of a 46 kB frame to a message of 100 bytes, embedded and over TCP on this host.
//!
//! `cargo bench -p ds-bus --bench hop` prints the median round of publish and receive. The budget of a frame's hop is
//! 2 ms embedded and 5 ms over TCP.

use std::time::{Duration, Instant};

use ds_bus::{BusSession, BusSettings, Subscription};
use ds_space::{AttemptId, Digest, EpisodeId, InstanceId, SimTime, Tick};
use ds_topic::{Envelope, Header, SCHEMA_VERSION, Slot, Topic};

const ROUNDS: usize = 400;

fn message(bytes: usize) -> Envelope {
    let header = Header {
        episode: EpisodeId::new("bench").expect("an id"),
        attempt: AttemptId(1),
        term: 1,
        epoch: 1,
        iteration: 0,
        tick: Tick(0),
        time: SimTime(0),
        sequence: 0,
        publisher: InstanceId::new("bench").expect("an id"),
        schema_version: SCHEMA_VERSION,
        trace: String::new(),
        slot: Slot::of_camera(Topic::Frame, 0, 0),
        content: Digest::default(),
    };
    Envelope { header, body: vec![7; bytes].into() }
}

async fn hop(sender: &BusSession, receiver: &mut Subscription, bytes: usize) -> Duration {
    let message = message(bytes);
    let mut rounds = Vec::with_capacity(ROUNDS);
    for _ in 0..ROUNDS {
        let start = Instant::now();
        loop {
            sender.publish(&message).await.expect("publishes");
            // A push may be lost; a round that needed a second one counts as slow as it was.
            if tokio::time::timeout(Duration::from_millis(500), receiver.recv()).await.is_ok() {
                break;
            }
        }
        rounds.push(start.elapsed());
    }
    rounds.sort();
    rounds[ROUNDS / 2]
}

async fn measure(name: &str, sender: &BusSession, receiver: &BusSession) {
    let episode = EpisodeId::new("bench").expect("an id");
    let mut subscription = receiver.subscribe(&episode, &[Topic::Frame]).await.expect("subscribes");
    let mut line = format!("hop {name:<9}");
    let small = hop(sender, &mut subscription, 100).await;
    for bytes in [100, 46_080, 1_200_000] {
        let median = hop(sender, &mut subscription, bytes).await;
        let ratio = median.as_secs_f64() / small.as_secs_f64();
        line += &format!("  {bytes} B: {:.3} ms ({ratio:.1}x)", median.as_secs_f64() * 1e3);
    }
    eprintln!("{line}");
}

fn main() {
    let runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().expect("a runtime");
    runtime.block_on(async {
        let embedded = BusSession::embedded().await.expect("opens");
        measure("embedded", &embedded, &embedded).await;
        let listen = vec!["tcp/127.0.0.1:0".to_owned()];
        let first = BusSession::open(&BusSettings { listen, ..BusSettings::default() }).await.expect("opens");
        let connect = first.listens().to_vec();
        let second = BusSession::open(&BusSettings { connect, ..BusSettings::default() }).await.expect("connects");
        measure("tcp", &first, &second).await;
    });
}
