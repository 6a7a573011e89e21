//! Spoiled cases end in a named error that says what is wrong, or in a diagnosis with a warning; never in a panic.

use std::path::Path;

use ds_frames::{FrameCase, Options, diagnose};

type Spoil = fn(&Path);

fn edit(path: &Path, change: impl Fn(&str) -> String) {
    let text = std::fs::read_to_string(path).expect("the file is there");
    std::fs::write(path, change(&text)).expect("the file can be written");
}

#[test]
fn spoiled_cases_are_refused_by_name() {
    let rows: [(&str, &str, Spoil); 10] = [
        ("no meta", "cannot read", |f| std::fs::remove_file(f.join("meta.json")).expect("removed")),
        ("meta is no JSON", "cannot understand", |f| edit(&f.join("meta.json"), |_| "{".to_owned())),
        ("no focal length", "absurd camera", |f| {
            edit(&f.join("meta.json"), |t| t.replace("\"fx\": 150.0", "\"fx\": 0.0"))
        }),
        ("other size", "picture is", |f| edit(&f.join("meta.json"), |t| t.replace("\"width\": 208", "\"width\": 200"))),
        ("no frames", "missing column", |f| edit(&f.join("frames.csv"), |_| String::new())),
        ("time goes back", "time goes back", |f| {
            edit(&f.join("frames.csv"), |t| t.replace("0.5000,0.5000", "0.1000,0.5000"))
        }),
        ("not a number", "not a number", |f| edit(&f.join("frames.csv"), |t| t.replace("0.5000,0.5000", "nan,0.5000"))),
        ("broken picture", "cannot decode", |f| std::fs::write(f.join("sim/0003.jpg"), b"no").expect("written")),
        ("pictures gone", "too few frames", |f| std::fs::remove_dir_all(f.join("real")).expect("removed")),
        ("blank stream", "shows nothing", |f| {
            for k in 0..12 {
                let grey = image::GrayImage::from_pixel(208, 128, image::Luma([90]));
                grey.save(f.join(format!("real/{k:04}.jpg"))).expect("written");
            }
        }),
    ];
    for (name, message, spoil) in rows {
        let folder = tempfile::tempdir().expect("a folder");
        crate::pair::write(folder.path(), 1, &[]);
        spoil(folder.path());
        match FrameCase::read(folder.path()).and_then(|case| diagnose(&case, &Options::default())) {
            Ok(_) => panic!("{name}: was diagnosed"),
            Err(error) => assert!(error.to_string().contains(message), "{name}: {error}"),
        }
    }
}

#[test]
fn a_case_without_depth_is_diagnosed_with_a_warning() {
    let folder = tempfile::tempdir().expect("a folder");
    crate::pair::write(folder.path(), 1, &[]);
    let found = diagnose(&FrameCase::read(folder.path()).expect("a case"), &Options::default()).expect("a diagnosis");
    assert!(found.warnings.iter().any(|w| w.contains("depth_proxy")), "{:?}", found.warnings);
}
