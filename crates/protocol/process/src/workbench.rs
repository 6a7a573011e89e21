//! The thread on which one episode's maker works, so that nothing slow runs on an async thread.
//!
//! A maker that panics loses its episode, never the process.

use std::any::Any;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;

use ds_episode::Fault;
use ds_episode::stage::{Event, Output};
use ds_topic::{Advance, Envelope, SceneMessage, Slot};
use ds_wire::Body;
use tokio::sync::mpsc;

use crate::maker::{Inputs, Maker, MakerFactory, bad};

/// What the maker shall do next.
pub(crate) enum Job {
    /// Restore from scene and inputs.
    Restore {
        /// The scene.
        scene: Envelope,
        /// The restore inputs.
        inputs: BTreeMap<Slot, Envelope>,
        /// The order to come.
        advance: Advance,
    },
    /// Work on an order.
    Work {
        /// The inputs.
        inputs: BTreeMap<Slot, Envelope>,
        /// The order.
        advance: Advance,
    },
}

/// What came of a job, and how long the maker took.
pub(crate) struct Done {
    /// To be handed to the stage.
    pub(crate) event: Event,
    /// The iteration that it was for.
    pub(crate) iteration: u32,
    /// The maker's own time.
    pub(crate) micros: u64,
}

/// Starts the thread; it ends when the sender of jobs is dropped.
pub(crate) fn start(factory: Arc<dyn MakerFactory>, done: mpsc::Sender<Done>) -> std::sync::mpsc::SyncSender<Job> {
    let (jobs, inbox) = std::sync::mpsc::sync_channel::<Job>(4);
    let name = format!("{}-maker", factory.role());
    let run = move || {
        let mut maker: Option<Box<dyn Maker>> = None;
        while let Ok(job) = inbox.recv() {
            let (Job::Restore { advance, .. } | Job::Work { advance, .. }) = &job;
            let (iteration, began) = (advance.iteration, Instant::now());
            let event = carry_out(&*factory, &mut maker, job);
            let micros = u64::try_from(began.elapsed().as_micros()).unwrap_or(u64::MAX);
            if done.blocking_send(Done { event, iteration, micros }).is_err() {
                break;
            }
        }
    };
    std::thread::Builder::new().name(name).spawn(run).expect("the system can start a thread");
    jobs
}

fn carry_out(factory: &dyn MakerFactory, maker: &mut Option<Box<dyn Maker>>, job: Job) -> Event {
    match job {
        Job::Restore { scene, inputs, advance } => {
            let result = guarded(|| {
                *maker = None;
                let message = SceneMessage::from_bytes(&scene.body).map_err(|e| bad(Fault::BAD_MESSAGE, &e))?;
                let mut opened = factory.open(Arc::new(message))?;
                opened.restore(&advance, &Inputs(inputs))?;
                *maker = Some(opened);
                Ok(())
            });
            Event::Restored { order: advance.content(), result }
        }
        Job::Work { inputs, advance } => {
            let result: Result<Vec<Output>, Fault> = guarded(|| match maker.as_mut() {
                Some(maker) => maker.work(&advance, &Inputs(inputs)),
                None => Err(Fault::deterministic("no_maker", "work came before a restore")),
            });
            if result.is_err() {
                *maker = None;
            }
            Event::Worked { order: advance.content(), result }
        }
    }
}

fn guarded<T>(job: impl FnOnce() -> Result<T, Fault>) -> Result<T, Fault> {
    catch_unwind(AssertUnwindSafe(job))
        .unwrap_or_else(|panic| Err(Fault::deterministic("maker_panicked", says(&*panic))))
}

fn says(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "without a message".to_owned())
}
