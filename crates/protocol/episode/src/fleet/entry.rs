//! The fleet's entries in the ledger as lines of text: `seat/{episode}/{role}` (epoch, instance, attempt, class, held),
//! `death/{episode}/{role}/{instance}` and `failure/{instance}/{episode}` (empty). Ids hold no '/' and no line break.

use std::collections::{BTreeMap, BTreeSet};

use ds_space::{AttemptId, EpisodeId, InstanceId};
use ds_topic::{Owner, Role};

use super::ledger::{Ledger, LedgerError, Write};
use super::member::ComputeClass;

/// The last holder of a role.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Seat {
    pub(super) owner: Owner,
    pub(super) attempt: AttemptId,
    /// The class that the attempt is bound to.
    pub(super) class: ComputeClass,
    pub(super) held: bool,
}

pub(super) fn write_seat((episode, role): &(EpisodeId, Role), seat: &Seat) -> Write {
    let held = if seat.held { "held" } else { "free" };
    let Owner { instance, epoch } = &seat.owner;
    let text = format!("{epoch}\n{instance}\n{}\n{held}\n{}", seat.attempt, seat.class.0);
    (format!("seat/{episode}/{role}"), Some(text.into_bytes()))
}

pub(super) fn write_death((episode, role): &(EpisodeId, Role), instance: &InstanceId) -> Write {
    (format!("death/{episode}/{role}/{instance}"), Some(Vec::new()))
}

pub(super) fn write_failure(instance: &InstanceId, episode: &EpisodeId) -> Write {
    (format!("failure/{instance}/{episode}"), Some(Vec::new()))
}

pub(super) fn seats(ledger: &impl Ledger) -> Result<BTreeMap<(EpisodeId, Role), Seat>, LedgerError> {
    let mut seats = BTreeMap::new();
    for (key, value) in ledger.entries("seat/")? {
        let (episode, role) = split(&key)?;
        let role = self::role(&key, role)?;
        let text = std::str::from_utf8(&value).map_err(|error| broken(&key, error.to_string()))?;
        let lines: Vec<&str> = text.splitn(5, '\n').collect();
        let [epoch, instance, attempt, held, class] = lines[..] else {
            return Err(broken(&key, format!("{} lines instead of 5", lines.len())));
        };
        let number = |text: &str| text.parse::<u64>().map_err(|error| broken(&key, format!("{text:?}: {error}")));
        let attempt = u32::try_from(number(attempt)?).map_err(|error| broken(&key, error.to_string()))?;
        let seat = Seat {
            owner: Owner { instance: self::instance(&key, instance)?, epoch: number(epoch)? },
            attempt: AttemptId(attempt),
            class: ComputeClass(class.to_owned()),
            held: held == "held",
        };
        seats.insert((self::episode(&key, episode)?, role), seat);
    }
    Ok(seats)
}

/// Instances that died, by the episode and role that they held.
pub(super) type Deaths = BTreeMap<(EpisodeId, Role), BTreeSet<InstanceId>>;

pub(super) fn deaths(ledger: &impl Ledger) -> Result<Deaths, LedgerError> {
    let mut deaths = Deaths::new();
    for (key, _) in ledger.entries("death/")? {
        let (episode, rest) = split(&key)?;
        let (role, instance) = rest.split_once('/').ok_or_else(|| broken(&key, "four parts expected".to_owned()))?;
        let seat = (self::episode(&key, episode)?, self::role(&key, role)?);
        deaths.entry(seat).or_default().insert(self::instance(&key, instance)?);
    }
    Ok(deaths)
}

pub(super) fn failures(ledger: &impl Ledger) -> Result<BTreeMap<InstanceId, BTreeSet<EpisodeId>>, LedgerError> {
    let mut failures: BTreeMap<InstanceId, BTreeSet<EpisodeId>> = BTreeMap::new();
    for (key, _) in ledger.entries("failure/")? {
        let (instance, episode) = split(&key)?;
        failures.entry(self::instance(&key, instance)?).or_default().insert(self::episode(&key, episode)?);
    }
    Ok(failures)
}

fn split(key: &str) -> Result<(&str, &str), LedgerError> {
    let mut parts = key.splitn(3, '/').skip(1);
    parts.next().zip(parts.next()).ok_or_else(|| broken(key, "three parts expected".to_owned()))
}

fn role(key: &str, text: &str) -> Result<Role, LedgerError> {
    Role::from_name(text).ok_or_else(|| broken(key, format!("unknown role {text:?}")))
}

fn episode(key: &str, text: &str) -> Result<EpisodeId, LedgerError> {
    EpisodeId::new(text).map_err(|error| broken(key, error.to_string()))
}

fn instance(key: &str, text: &str) -> Result<InstanceId, LedgerError> {
    InstanceId::new(text).map_err(|error| broken(key, error.to_string()))
}

fn broken(key: &str, detail: String) -> LedgerError {
    LedgerError::Broken { key: key.to_owned(), detail }
}
