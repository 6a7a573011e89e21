//! A recording becomes pictures; what was drawn is looked for in the results.
//!
//! The files stay in the target folder (`tmp/showing`) for a look.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use ds_raster::{Encoding, RgbImage};
use ds_record::Recording;

use crate::drive::{Drive, completed};

const LAST_TICK: u32 = 30;
const EGO: [u8; 3] = [64, 222, 128];

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("showing");
    fs::create_dir_all(&folder).expect("the target folder is writable");
    folder
}

static RECORDING: LazyLock<Recording> = LazyLock::new(|| {
    let drive = Drive::new(&["front"], LAST_TICK);
    let path = folder().join("drive.mcap");
    drive.record(&path, drive.iterations()).finish(&completed()).expect("finishes");
    Recording::open(&path).expect("opens")
});

/// Returns the centre of all pixels near a colour, in pixels, and how many they are.
fn blob(image: &RgbImage, colour: [u8; 3]) -> (f64, f64, usize) {
    let (mut x_sum, mut y_sum, mut count) = (0.0, 0.0, 0);
    for y in 0..image.height_px() {
        for x in 0..image.width_px() {
            if image.pixel(x, y).iter().zip(colour).all(|(a, b)| a.abs_diff(b) <= 12) {
                x_sum += f64::from(x);
                y_sum += f64::from(y);
                count += 1;
            }
        }
    }
    (x_sum / f64::from(count.max(1)), y_sum / f64::from(count.max(1)), count as usize)
}

#[test]
fn the_animation_shows_every_tick_with_the_ego_in_its_place() {
    let path = folder().join("drive.gif");
    RECORDING.reel().expect("states decode").animate(&path).expect("animates");
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(fs::File::open(&path).expect("is there")).expect("is a GIF");
    let (width, height) = (u32::from(decoder.width()), u32::from(decoder.height()));
    // Two columns of 320 pixels: frame above layout at twice their size, each under a caption; and the view from above.
    assert_eq!((width, height), (640, 2 * (192 + 16)));
    let mut screen = RgbImage::filled(width, height, [0; 3]);
    let mut count = 0;
    while let Some(frame) = decoder.read_next_frame().expect("frames are sound") {
        for (pixel, new) in screen.rgb_mut().chunks_exact_mut(3).zip(frame.buffer.chunks_exact(4)) {
            if new[3] > 0 {
                pixel.copy_from_slice(&new[..3]);
            }
        }
        let (x, y, pixels) = blob(&screen, EGO);
        assert!(
            (x - 480.0).abs() < 4.0 && (y - 300.0).abs() < 25.0 && pixels > 200,
            "ego at {x}, {y}: {pixels} pixels"
        );
        count += 1;
    }
    assert_eq!(count, LAST_TICK + 1);
}

#[test]
fn the_contact_sheet_has_eight_moments() {
    let path = folder().join("sheet.png");
    RECORDING.reel().expect("states decode").contact_sheet(&path).expect("draws");
    let bytes = fs::read(&path).expect("is there");
    let sheet = RgbImage::decode(Encoding::Png, 2 * 640 + 8, 4 * (416 + 8), &bytes).expect("has the size of eight");
    let (_, _, pixels) = blob(&sheet, EGO);
    assert!(pixels > 8 * 200, "the ego has {pixels} pixels");
}
