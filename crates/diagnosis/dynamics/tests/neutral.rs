//! Every effect at its neutral value leaves the simulator as it was, bit for bit; away from it, it shows in a channel it
//! names, a sensor's error in no other.

use ds_dynamics::case::{Case, PartModel};
use ds_dynamics::fit::Model as _;
use ds_dynamics::space::{Part, SCATTER};
use ds_dynamics::synthetic;
use ds_effect::{Channel, Insertion, Scale, library};

fn case() -> Case {
    let folder = tempfile::tempdir().expect("a folder");
    synthetic::write_case(folder.path(), 5, &|_| {}).expect("the case can be written");
    Case::read(folder.path()).expect("the case can be read")
}

#[test]
fn neutral_values_change_no_bit() {
    let case = case();
    let nominal = case.meta.nominal.plant();
    for effect in library() {
        let mut edited = case.meta.nominal.plant();
        (effect.apply)(&effect.neutral(), &mut edited);
        for record in &case.ego {
            let (a, b) = (record.residuals(&nominal), record.residuals(&edited));
            assert!(a.iter().zip(&b).all(|(a, b)| a.to_bits() == b.to_bits()), "{} changes the ego", effect.id);
        }
        for record in &case.following {
            let (a, b) = (record.residuals(&nominal), record.residuals(&edited));
            assert!(a.iter().zip(&b).all(|(a, b)| a.to_bits() == b.to_bits()), "{} changes followers", effect.id);
        }
    }
}

#[test]
fn ids_are_unique_and_priors_make_sense() {
    let mut ids: Vec<&str> = library().iter().map(|e| e.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), library().len());
    for effect in library() {
        assert!(!effect.parameters.is_empty(), "{} has no parameter", effect.id);
        for p in effect.parameters {
            assert!(p.slab.0 <= p.slab.1, "{}: empty slab", effect.id);
            assert!(p.nuisance.is_none_or(|n| n.sd > 0.0), "{}: nuisance without spread", effect.id);
            let value = p.reported(0.3, 1500.0);
            assert!((p.searched(value, 1500.0) - 0.3).abs() < 1e-12, "{}: search and report disagree", effect.id);
        }
    }
}

#[test]
fn effects_show_where_they_say() {
    let case = case();
    let drives = [0, 1, 2, 3];
    let mut faults = Vec::new();
    for part in [Part::Ego, Part::Following] {
        let model = PartModel::new(&case, part, &drives, &[]);
        let neutral = model.space.neutral();
        let plain = model.residuals(&neutral);
        for (k, effect) in model.space.effects.iter().enumerate() {
            let at = model.space.of(k)[0];
            let p = model.space.coordinates[at].parameter;
            let mut vector = neutral.clone();
            vector[at] = if p.scale == Scale::Limit || p.slab.1 <= p.neutral { p.slab.0 } else { p.slab.1 };
            let moved = model.residuals(&vector);
            let mut size = [0.0_f64; Channel::ALL.len()];
            for ((tag, a), b) in model.tags.iter().zip(&plain).zip(&moved) {
                size[tag.channel.index()] = size[tag.channel.index()].max((a - b).abs());
            }
            assert!(!SCATTER.contains(&effect.id));
            if !effect.channels.iter().any(|c| size[c.index()] > 1e-6) {
                faults.push(format!("{} shows nowhere", effect.id));
            }
            // speed and heading couple the channels of a vehicle; a sensor's error stays in its own
            for channel in Channel::ALL {
                let named = effect.channels.contains(&channel);
                if effect.insertion == Insertion::Sensor && !named && size[channel.index()] > 1e-9 {
                    faults.push(format!("{} shows in {} too", effect.id, channel.name()));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}
