//! The adversary of a scenario, checked against its tracks.

use ds_space::{AgentId, Tick};
use ds_world::{Adversary, AdversaryMode, AgentClass, Budget, CrashClass, Track};

use crate::error::FieldError;
use crate::field::{choice, enumeration, number};
use crate::geometry::points;
use crate::v1;

enumeration!(v1::CrashClass, CrashClass, {
    RearEnd = RearEnd,
    ChangingLanes = ChangingLanes,
    OppositeDirection = OppositeDirection,
    StraightCrossingPaths = StraightCrossingPaths,
    LeftTurnAcrossPath = LeftTurnAcrossPath,
});

enumeration!(v1::AdversaryMode, AdversaryMode, {
    Replay = Replay,
    Reactive = Reactive,
    Unshielded = Unshielded,
});

impl From<&Adversary> for v1::Adversary {
    fn from(value: &Adversary) -> Self {
        Self {
            track: value.track.0,
            class: v1::CrashClass::from(value.class).into(),
            mode: v1::AdversaryMode::from(value.mode).into(),
            attack_tick: value.attack.0,
            contact_tick: value.contact.0,
            attack_secs: Some(value.budget.attack_secs),
            effort_mps: Some(value.budget.effort_mps),
            aside_m: Some(value.budget.aside_m),
            reaims: value.budget.reaims,
            corridor: Some(value.corridor.as_slice().into()),
        }
    }
}

/// Takes the adversary of a scenario with these tracks.
pub(crate) fn adversary(message: v1::Adversary, tracks: &[Track]) -> Result<Adversary, FieldError> {
    let fault = |field: &str, problem: String| FieldError::new(field, problem);
    let track = tracks.get(message.track as usize);
    if !track.is_some_and(|track| track.class == AgentClass::Vehicle && track.points.iter().all(Option::is_some)) {
        return Err(fault("track", format!("is {}, no vehicle that is always there", message.track)));
    }
    if message.attack_tick >= message.contact_tick {
        let problem = format!("is {}, not before the contact at {}", message.attack_tick, message.contact_tick);
        return Err(fault("attack_tick", problem));
    }
    let within = |field: &'static str, value: Option<f64>, most: f64| {
        let value = number(field, value)?;
        if (0.0..=most).contains(&value) {
            Ok(value)
        } else {
            Err(fault(field, format!("is {value}, not 0 to {most}")))
        }
    };
    Ok(Adversary {
        track: AgentId(message.track),
        class: choice::<v1::CrashClass, _>("class", message.class)?,
        mode: choice::<v1::AdversaryMode, _>("mode", message.mode)?,
        attack: Tick(message.attack_tick),
        contact: Tick(message.contact_tick),
        budget: Budget {
            attack_secs: within("attack_secs", message.attack_secs, 60.0)?,
            effort_mps: within("effort_mps", message.effort_mps, 1000.0)?,
            aside_m: within("aside_m", message.aside_m, 20.0)?,
            reaims: message.reaims,
        },
        corridor: points("corridor", message.corridor, 2)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::{DVec2, PoseSe2};
    use ds_world::{Size, TrackPoint};

    #[test]
    fn goes_over_the_wire_and_is_checked_against_the_tracks() {
        let point = TrackPoint { pose: PoseSe2::default(), z_m: 0.0, velocity_mps: DVec2::ZERO };
        let size = Size { length_m: 4.0, width_m: 2.0, height_m: 1.5 };
        let track = |points| Track { name: "a".to_owned(), class: AgentClass::Vehicle, size, points };
        let tracks = [track(vec![Some(point), None]), track(vec![Some(point), Some(point)])];
        let value = Adversary {
            track: AgentId(1),
            class: CrashClass::OppositeDirection,
            mode: AdversaryMode::Unshielded,
            attack: Tick(3),
            contact: Tick(9),
            budget: Budget::default(),
            corridor: vec![DVec2::ZERO, DVec2::ONE],
        };
        assert_eq!(adversary((&value).into(), &tracks), Ok(value.clone()));
        let refused = |change: fn(&mut v1::Adversary)| {
            let mut message = v1::Adversary::from(&value);
            change(&mut message);
            adversary(message, &tracks).expect_err("it is refused").of("adversary").to_string()
        };
        assert!(refused(|message| message.track = 0).contains("always there"));
        assert!(refused(|message| message.track = 2).contains("is 2"));
        assert!(refused(|message| message.contact_tick = 3).contains("not before the contact at 3"));
        assert!(refused(|message| message.aside_m = Some(21.0)).contains("is 21"));
        assert!(refused(|message| message.mode = 0).contains("unspecified"));
    }
}
