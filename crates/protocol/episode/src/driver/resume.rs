//! How an attempt goes on from its journal: what was committed is final, everything later is ordered again.

use std::sync::Arc;

use ds_space::Tick;
use ds_topic::{Advance, Envelope, Motion, Slot, Topic};

use super::{Attempt, Committed, Driver, EncodedScene};
use crate::codec::{Codec, CodecError};
use crate::due;
use crate::timing::Timing;

/// A journal that an attempt cannot go on from.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ResumeError {
    /// The scene or the last plan cannot be read.
    #[error("journal body cannot be read")]
    Codec(#[from] CodecError),
    /// A committed iteration lacks a message.
    #[error("iteration {iteration} is committed but the journal lacks {slot}")]
    Missing {
        /// The iteration.
        iteration: u32,
        /// What it lacks.
        slot: Slot,
    },
    /// More iterations than the episode has.
    #[error("{committed} iterations are committed, the episode has {iterations}")]
    TooMany {
        /// Committed ones.
        committed: u32,
        /// Those of the episode.
        iterations: u32,
    },
}

/// What the journal of an attempt holds.
#[derive(Debug, Clone)]
pub struct Journal<'a> {
    /// How many iterations are committed, from iteration 0 on.
    pub iterations: u32,
    /// All its messages; those of later iterations are ignored.
    pub messages: &'a [Envelope],
}

impl Driver {
    /// Prepares to go on after the last committed iteration, under a new term.
    ///
    /// # Errors
    /// [`ResumeError`] if the journal does not hold what its commits say.
    pub fn resume(
        attempt: Attempt,
        timing: Timing,
        codec: Arc<dyn Codec>,
        scene: EncodedScene,
        journal: &Journal<'_>,
    ) -> Result<Self, ResumeError> {
        let mut driver = Self::new(attempt, timing, codec, scene)?;
        let iterations = driver.outline.spec.iterations();
        if journal.iterations > iterations {
            return Err(ResumeError::TooMany { committed: journal.iterations, iterations });
        }
        let mut held = std::collections::BTreeMap::new();
        for message in journal.messages {
            held.entry(message.header.slot).or_insert(message);
            if message.header.slot.topic == Topic::Event {
                driver.events = driver.events.max(message.header.slot.index + 1);
            }
        }
        for iteration in 0..journal.iterations {
            let (first, last) = driver.outline.spec.ticks_of(iteration);
            for slot in due::all_outputs(&driver.outline, &outline_order(&driver, iteration, (first, last))) {
                let message = held.get(&slot).ok_or(ResumeError::Missing { iteration, slot })?;
                let header = &message.header;
                driver.committed.insert(slot, Committed { content: header.content, epoch: header.epoch });
                if slot.topic == Topic::World {
                    driver.unobserved.push((*message).clone());
                    driver.border = header.content;
                }
                if slot == Slot::new(Topic::Plan, journal.iterations - 1) {
                    driver.plan = Some(driver.codec.decode_plan(&message.body)?);
                }
            }
        }
        driver.committed_iterations = journal.iterations;
        Ok(driver)
    }
}

/// An order with all that decides what is due.
fn outline_order(driver: &Driver, iteration: u32, (first, last): (Tick, Tick)) -> Advance {
    Advance {
        iteration,
        first,
        last,
        motion: Motion::Initial,
        border: ds_space::Digest::default(),
        plan_due: due::plan_due(&driver.outline.spec, iteration),
        owners: std::collections::BTreeMap::new(),
    }
}
