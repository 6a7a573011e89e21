//! Cases of several clips with several seeds each: an effect is found and nothing where nothing was injected, constants are
//! not testable without effect-free clips, and a damaged or incomplete case is refused by name.

use std::path::Path;

use ds_diagnosis::{Diagnosis, Verdict};
use ds_frames::{Nuisance, Options, SightError, Streams};

/// Writes a case of some clips, each with two simulated streams.
fn clips(folder: &Path, seed: u64, count: u64, injected: &[(&str, &[f64])]) {
    let names: Vec<String> = (0..count).map(|clip| format!("clip_{clip}")).collect();
    for (clip, name) in (0..).zip(&names) {
        let clip_folder = folder.join(name);
        crate::pair::write(&clip_folder, 100 * seed + clip, injected);
        std::fs::rename(clip_folder.join("sim"), clip_folder.join("sim_0")).expect("renamed");
        std::fs::create_dir(clip_folder.join("sim_1")).expect("a folder");
        for frame in std::fs::read_dir(clip_folder.join("sim_0")).expect("frames") {
            let frame = frame.expect("a frame");
            let picture = image::open(frame.path()).expect("a picture").into_luma8();
            let other = image::imageops::brighten(&picture, i32::from(clip % 2 == 0));
            other.save(clip_folder.join("sim_1").join(frame.file_name())).expect("saved");
        }
        with(&clip_folder, r#""pairing": "same-layout", "seeds": ["sim_0", "sim_1"],"#);
    }
    std::fs::copy(folder.join("clip_0/meta.json"), folder.join("meta.json")).expect("copied");
    with(folder, &format!("\"clips\": {names:?},"));
}

fn with(folder: &Path, entry: &str) {
    let path = folder.join("meta.json");
    let text = std::fs::read_to_string(&path).expect("meta.json");
    std::fs::write(&path, text.replacen('{', &format!("{{{entry}"), 1)).expect("meta.json");
}

fn told(folder: &Path, nuisance: Option<&Nuisance>) -> Result<Diagnosis, SightError> {
    Streams::read(folder)?.diagnose(&Options { nuisance: nuisance.cloned(), ..Options::default() })
}

#[test]
fn an_effect_on_clips_is_found_and_a_constant_only_beside_effect_free_ones() {
    let root = tempfile::tempdir().expect("a folder");
    clips(&root.path().join("free/a"), 1, 8, &[]);
    clips(&root.path().join("none"), 2, 6, &[]);
    clips(&root.path().join("turned"), 3, 6, &[("mount_pitch", &[0.8])]);
    let nuisance = Nuisance::learn(&root.path().join("free")).expect("effect-free clips");
    let free = told(&root.path().join("none"), Some(&nuisance)).expect("a diagnosis");
    assert_eq!(free.verdict, Verdict::None, "{:?}", free.chosen);
    let turned = told(&root.path().join("turned"), Some(&nuisance)).expect("a diagnosis");
    assert_eq!(turned.effects.first().map(|e| e.id.as_str()), Some("mount_pitch"), "{:?}", turned.chosen);
    assert!((turned.effects[0].value - 0.8).abs() < 0.2, "{}", turned.effects[0].value);
    let alone = told(&root.path().join("turned"), None).expect("a diagnosis");
    let limit = alone.detection_limits.iter().find(|l| l.id == "mount_pitch").expect("its limit");
    assert_eq!((alone.verdict, limit.limit), (Verdict::None, None), "{:?}", alone.chosen);
    assert!(alone.warnings.iter().any(|w| w.contains("not testable") && w.contains("mount_pitch")));
}

#[test]
fn incomplete_cases_are_refused_by_name() {
    type Spoil = fn(&Path);
    let rows: [(&str, Spoil); 5] = [
        ("cannot read", |f| std::fs::remove_file(f.join("clip_3/meta.json")).expect("removed")),
        ("missing frames", |f| std::fs::remove_file(f.join("clip_2/sim_1/0004.jpg")).expect("removed")),
        ("too few frames", |f| std::fs::remove_dir_all(f.join("clip_2/sim_1")).expect("removed")),
        ("cannot decode", |f| std::fs::write(f.join("clip_1/sim_0/0003.jpg"), b"no").expect("written")),
        ("too few seeds", |f| {
            let path = f.join("clip_1/meta.json");
            let text = std::fs::read_to_string(&path).expect("meta.json");
            std::fs::write(&path, text.replace(r#", "sim_1""#, "")).expect("meta.json");
        }),
    ];
    for (message, spoil) in rows {
        let root = tempfile::tempdir().expect("a folder");
        clips(root.path(), 5, 6, &[]);
        spoil(root.path());
        let refused = told(root.path(), None).expect_err(message);
        assert!(refused.to_string().contains(message), "{message}: {refused}");
    }
    let root = tempfile::tempdir().expect("a folder");
    clips(root.path(), 5, 3, &[]);
    assert!(told(root.path(), None).is_err_and(|e| e.to_string().contains("too few clips")));
}
