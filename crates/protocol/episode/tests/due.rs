//! Laws of what is due, for episodes of any shape: every slot is made once, and nothing is taken that is not made before.

use std::collections::{BTreeMap, BTreeSet};

use ds_episode::{Outline, due};
use ds_space::{Digest, EpisodeId, SimTime, Tick};
use ds_topic::{Advance, EpisodeSpec, Motion, ObservationSource, Role, Slot, Topic};
use proptest::prelude::*;

fn outlines() -> impl Strategy<Value = Outline> {
    (1..5_u32, 1..4_u32, 0..4_u32, 1..14_u32, 0..4_u32, 1..3_u16, 0..9_u32).prop_map(
        |(replan_period, history, warm_up, last, chunk_ticks, cameras, layout_memory_ticks)| {
            let video = chunk_ticks > 0;
            let spec = EpisodeSpec {
                policy: "toy".to_owned(),
                observation: if video { ObservationSource::Dreamstream } else { ObservationSource::SimRgb },
                replan_period,
                horizon: 8,
                history,
                warm_up,
                chunk_ticks,
                layout_memory_ticks,
                ..EpisodeSpec::replay(EpisodeId::new("e").expect("a valid id"), "toy", Tick(last))
            };
            Outline { spec, cameras, dt: SimTime(100_000_000) }
        },
    )
}

fn orders(outline: &Outline) -> Vec<Advance> {
    let order = |iteration| {
        let (first, last) = outline.spec.ticks_of(iteration);
        let plan_due = due::plan_due(&outline.spec, iteration);
        let (motion, border, owners) = (Motion::Log, Digest::default(), BTreeMap::new());
        Advance { iteration, first, last, motion, border, plan_due, owners }
    };
    (0..outline.spec.iterations()).map(order).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn every_slot_is_made_once_and_all_ticks_are(outline in outlines()) {
        let mut made = BTreeSet::new();
        for order in orders(&outline) {
            for slot in due::all_outputs(&outline, &order) {
                prop_assert!(made.insert(slot), "{slot} is made twice");
                prop_assert!(due::tick_of(&outline.spec, slot) <= order.last, "{slot} describes a later tick");
            }
        }
        for tick in 0..=outline.spec.last_tick.0 {
            prop_assert!(made.contains(&Slot::new(Topic::World, tick)));
            prop_assert!(made.contains(&Slot::of_camera(Topic::Frame, tick, outline.cameras - 1)));
        }
    }

    #[test]
    fn nothing_is_taken_that_is_not_made_by_then(outline in outlines()) {
        let mut made = BTreeSet::new();
        for order in orders(&outline) {
            for role in Role::ALL {
                for slot in due::restore_inputs(&outline, role, &order) {
                    prop_assert!(made.contains(&slot), "{role} restores from {slot} before it is committed");
                }
            }
            made.extend(due::all_outputs(&outline, &order));
            for role in Role::ALL {
                for slot in due::inputs(&outline, role, &order) {
                    prop_assert!(made.contains(&slot), "{role} takes {slot} before it is made");
                    prop_assert!(due::takes(role, slot.topic, &outline.spec));
                    prop_assert!(due::maker(slot.topic) != Some(role));
                }
            }
        }
    }

    #[test]
    fn plans_are_due_exactly_where_a_later_iteration_follows_one(outline in outlines()) {
        let spec = &outline.spec;
        for order in orders(&outline) {
            let next = order.iteration + 1;
            prop_assert_eq!(order.plan_due, next < spec.iterations() && next > spec.warm_up);
        }
    }
}
