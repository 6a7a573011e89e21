//! Colours of sky and light of each condition, in linear light: what [`crate::light::Light`] is made of.

use ds_space::Vec3;

use ds_world::{Lighting, Weather};

/// Colours of a time of day, under a clear and under a closed sky.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Look {
    pub(crate) zenith: Vec3,
    pub(crate) horizon: Vec3,
    /// Added near the horizon on the sun's side.
    pub(crate) afterglow: Vec3,
    /// Direct light of the sun; none where it is below the horizon.
    pub(crate) sun: Vec3,
    pub(crate) ambient: Vec3,
    pub(crate) headlight: f32,
}

fn clear(lighting: Lighting) -> Look {
    let v = Vec3::new;
    let look = |zenith, horizon, afterglow, sun, ambient, headlight| Look {
        zenith,
        horizon,
        afterglow,
        sun,
        ambient,
        headlight,
    };
    match lighting {
        Lighting::Day => look(
            v(0.11, 0.26, 0.58),
            v(0.56, 0.69, 0.84),
            v(0.0, 0.0, 0.0),
            v(1.35, 1.27, 1.14),
            v(0.40, 0.47, 0.58),
            0.0,
        ),
        Lighting::Sunrise => look(
            v(0.20, 0.27, 0.48),
            v(0.70, 0.50, 0.52),
            v(0.62, 0.28, 0.20),
            v(1.05, 0.60, 0.46),
            v(0.35, 0.31, 0.38),
            0.25,
        ),
        Lighting::Sunset => look(
            v(0.17, 0.16, 0.32),
            v(0.66, 0.29, 0.13),
            v(0.75, 0.26, 0.05),
            v(1.05, 0.40, 0.14),
            v(0.32, 0.22, 0.22),
            0.25,
        ),
        Lighting::GoldenHour => look(
            v(0.24, 0.32, 0.44),
            v(0.80, 0.64, 0.36),
            v(0.42, 0.28, 0.08),
            v(1.55, 1.05, 0.48),
            v(0.44, 0.38, 0.29),
            0.0,
        ),
        Lighting::Twilight => look(
            v(0.045, 0.04, 0.11),
            v(0.20, 0.10, 0.17),
            v(0.36, 0.11, 0.05),
            Vec3::ZERO,
            v(0.115, 0.085, 0.125),
            0.55,
        ),
        Lighting::BlueHour => look(
            v(0.012, 0.04, 0.17),
            v(0.06, 0.13, 0.36),
            v(0.02, 0.03, 0.05),
            Vec3::ZERO,
            v(0.040, 0.075, 0.175),
            0.55,
        ),
        Lighting::Night => {
            look(v(0.004, 0.005, 0.012), v(0.030, 0.029, 0.034), Vec3::ZERO, Vec3::ZERO, v(0.035, 0.038, 0.05), 1.0)
        }
    }
}

/// Brightness and cast of a closed sky, relative to that of the day.
fn cast(lighting: Lighting) -> Vec3 {
    let (level, cast) = match lighting {
        Lighting::Day => (1.0, Vec3::ONE),
        Lighting::Sunrise => (0.55, Vec3::new(1.14, 0.93, 0.99)),
        Lighting::Sunset => (0.5, Vec3::new(1.32, 0.86, 0.70)),
        Lighting::GoldenHour => (0.8, Vec3::new(1.18, 1.0, 0.72)),
        Lighting::Twilight => (0.17, Vec3::new(1.12, 0.82, 1.12)),
        Lighting::BlueHour => (0.15, Vec3::new(0.5, 0.82, 1.7)),
        Lighting::Night => (0.05, Vec3::new(0.95, 0.98, 1.1)),
    };
    cast * level
}

/// Mixes the colours of a time of day and a weather, with a cloud cover from 0 to 1.
pub(crate) fn of(lighting: Lighting, weather: Weather, cloud: f32) -> Look {
    let clear = clear(lighting);
    let dim = match weather {
        Weather::Rain => 0.72,
        Weather::Snow => 1.06,
        _ => 1.0,
    };
    let grey = cast(lighting) * dim;
    let mix = |a: Vec3, b: Vec3| a + (b - a) * cloud;
    Look {
        zenith: mix(clear.zenith, Vec3::new(0.46, 0.48, 0.52) * grey),
        horizon: mix(clear.horizon, Vec3::new(0.64, 0.66, 0.68) * grey),
        afterglow: clear.afterglow * (1.0 - 0.8 * cloud),
        sun: clear.sun * (1.0 - 0.94 * cloud),
        ambient: mix(clear.ambient, Vec3::new(0.74, 0.76, 0.79) * grey),
        headlight: clear.headlight.max(match weather {
            Weather::Fog | Weather::Snow | Weather::Rain => 0.12,
            _ => 0.0,
        }),
    }
}
