//! Cases of several clips with several seeds each: an effect is found and nothing where nothing was injected, constants are
//! not testable without effect-free clips, and a damaged or incomplete case is refused by name.

use std::path::Path;

use ds_diagnosis::{Diagnosis, Verdict};
use ds_frames::{FramesError, Nuisance, Options, Streams};

/// Writes a case of some clips, each with two simulated streams; a quarter of the pictures of a pair is enough.
fn clips(folder: &Path, seed: u64, count: u64, injected: &[(&str, &[f64])]) {
    let names: Vec<String> = (0..count).map(|clip| format!("clip_{clip}")).collect();
    for (clip, name) in (0..).zip(&names) {
        let clip_folder = folder.join(name);
        crate::pair::write(&clip_folder, 100 * seed + clip, injected);
        std::fs::create_dir(clip_folder.join("sim_1")).expect("a folder");
        for stream in ["sim", "real"] {
            for frame in std::fs::read_dir(clip_folder.join(stream)).expect("frames") {
                let path = frame.expect("a frame").path();
                let picture = image::open(&path).expect("a picture").crop_imm(52, 32, 104, 64).into_luma8();
                picture.save(&path).expect("saved");
                if stream == "sim" {
                    let other = image::imageops::brighten(&picture, i32::from(clip % 2 == 0));
                    other.save(clip_folder.join("sim_1").join(path.file_name().expect("a name"))).expect("saved");
                }
            }
        }
        std::fs::rename(clip_folder.join("sim"), clip_folder.join("sim_0")).expect("renamed");
        edit(&clip_folder, "\"width\": 208, \"height\": 128", "\"width\": 104, \"height\": 64");
        edit(&clip_folder, "\"cx\": 104.0, \"cy\": 60.0", "\"cx\": 52.0, \"cy\": 28.0");
        edit(&clip_folder, "{", r#"{"pairing": "same-layout", "seeds": ["sim_0", "sim_1"],"#);
    }
    std::fs::copy(folder.join("clip_0/meta.json"), folder.join("meta.json")).expect("copied");
    edit(folder, "{", &format!("{{\"clips\": {names:?},"));
}

fn edit(folder: &Path, from: &str, to: &str) {
    let path = folder.join("meta.json");
    let text = std::fs::read_to_string(&path).expect("meta.json");
    std::fs::write(&path, text.replacen(from, to, 1)).expect("meta.json");
}

/// Copies all that lies in a folder.
fn copy(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).expect("a folder") {
        let (path, copied) = entry.map(|entry| (entry.path(), to.join(entry.file_name()))).expect("an entry");
        if path.is_dir() {
            std::fs::create_dir(&copied).expect("a folder");
            copy(&path, &copied);
        } else {
            std::fs::copy(&path, &copied).expect("copied");
        }
    }
}

fn told(folder: &Path, nuisance: Option<&Nuisance>) -> Result<Diagnosis, FramesError> {
    Streams::read(folder)?.diagnose(&Options { nuisance: nuisance.cloned(), ..Options::default() })
}

#[test]
fn an_effect_on_clips_is_found_and_a_constant_only_beside_effect_free_ones() {
    let root = tempfile::tempdir().expect("a folder");
    clips(&root.path().join("free/a"), 1, 12, &[]);
    clips(&root.path().join("none"), 2, 6, &[]);
    clips(&root.path().join("curved"), 3, 6, &[("gamma", &[1.3])]);
    let nuisance = Nuisance::learn(&root.path().join("free")).expect("effect-free clips");
    let free = told(&root.path().join("none"), Some(&nuisance)).expect("a diagnosis");
    assert_eq!(free.verdict, Verdict::None, "{:?}", free.chosen);
    let curved = told(&root.path().join("curved"), Some(&nuisance)).expect("a diagnosis");
    assert_eq!(curved.effects.first().map(|e| e.id.as_str()), Some("gamma"), "{:?}", &curved.effects[..3]);
    assert!((curved.effects[0].value - 1.3).abs() < 0.1, "{}", curved.effects[0].value);
    let alone = told(&root.path().join("curved"), None).expect("a diagnosis");
    let limit = alone.detection_limits.iter().find(|l| l.id == "gamma").expect("its limit");
    assert_eq!((alone.verdict, limit.limit), (Verdict::None, None), "{:?}", alone.chosen);
    assert!(alone.warnings.iter().any(|w| w.contains("not testable") && w.contains("gamma")));
}

#[test]
fn incomplete_cases_are_refused_by_name() {
    type Spoil = fn(&Path);
    let rows: [(&str, Spoil); 5] = [
        ("cannot read", |f| std::fs::remove_file(f.join("clip_3/meta.json")).expect("removed")),
        ("missing frames", |f| std::fs::remove_file(f.join("clip_2/sim_1/0004.jpg")).expect("removed")),
        ("too few frames", |f| std::fs::remove_dir_all(f.join("clip_2/sim_1")).expect("removed")),
        ("cannot decode", |f| std::fs::write(f.join("clip_1/sim_0/0003.jpg"), b"no").expect("written")),
        ("too few seeds", |f| edit(&f.join("clip_1"), r#", "sim_1""#, "")),
    ];
    let sound = tempfile::tempdir().expect("a folder");
    clips(sound.path(), 5, 6, &[]);
    for (message, spoil) in rows {
        let root = tempfile::tempdir().expect("a folder");
        copy(sound.path(), root.path());
        spoil(root.path());
        let refused = told(root.path(), None).expect_err(message);
        assert!(refused.to_string().contains(message), "{message}: {refused}");
    }
    let root = tempfile::tempdir().expect("a folder");
    clips(root.path(), 5, 3, &[]);
    assert!(told(root.path(), None).is_err_and(|e| e.to_string().contains("too few clips")));
}
