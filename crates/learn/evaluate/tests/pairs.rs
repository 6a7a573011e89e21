//! Cases of the diagnosis of frames, made of a model's frames.

use std::path::Path;

use ds_camera::ReferenceWorld;
use ds_diagnosis::meta::FrameMeta;
use ds_evaluate::arm::Arm;
use ds_evaluate::pairs::{self, PairsPlan};
use ds_topic::ObservationSource;

fn sorted(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").file_name());
    let mut names: Vec<String> = entries.map(|name| name.to_string_lossy().into_owned()).collect();
    names.sort_unstable();
    names
}

/// Two seeds of one state differ, the world's own frames and the depths are those of the state: what stands on the road in the lower
/// half of the picture, lines among it, is near.
#[test]
fn a_case_holds_every_clip_with_its_seeds_and_true_depths() {
    let models = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../configs/models"));
    let [preset, weights] = ["smoke.toml", "smoke.safetensors"].map(|name| models.join(name));
    let arm = Arm::of_source(ObservationSource::Dreamstream, &preset, &weights, Path::new("absent")).expect("loads");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let case = folder.path().join("case_0");
    let look = "daylight".to_owned();
    let plan = PairsPlan { first_seed: 5, clips: 2, seeds: 2, first: 2, frames: 6, look, over: 2 };
    pairs::write(&ReferenceWorld, &arm, &plan, 0, &case).expect("writes");

    let meta = FrameMeta::read(&case).expect("reads");
    assert_eq!(meta.clips.len(), 2);
    for clip in meta.clips.iter().map(|name| case.join(name)) {
        let meta = FrameMeta::read(&clip).expect("reads");
        let names: Vec<String> = (2..8).map(|number| format!("{number:04}.png")).collect();
        let streams =
            [meta.seeds.iter().map(|seed| clip.join(seed)).collect(), vec![clip.join("real"), clip.join("large")]];
        for stream in streams.concat() {
            assert_eq!(sorted(&stream), names, "{}", stream.display());
        }
        let bytes = |seed: usize| std::fs::read(clip.join(&meta.seeds[seed]).join(&names[0])).expect("a frame");
        assert_ne!(bytes(0), bytes(1), "the seed draws another frame");
        for name in &names {
            let depth_cm = image::open(clip.join("depth").join(name)).expect("a picture").to_luma16();
            let (width, height) = depth_cm.dimensions();
            assert_eq!([width as usize, height as usize], [meta.width, meta.height]);
            let low = depth_cm.enumerate_pixels().filter(|(_, y, _)| *y > 3 * height / 4);
            let farthest_m = f64::from(low.map(|(_, _, cm)| cm.0[0]).max().expect("pixels")) / 100.0;
            assert!(farthest_m < 30.0, "{name} is {farthest_m} m away near the lower border");
        }
    }
}
