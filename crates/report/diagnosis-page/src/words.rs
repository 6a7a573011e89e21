//! Names, units and numbers as a reader expects them: ids of effects, channels and metrics in words, figures with the
//! digits that their interval supports.
//!
//! Ids that no table knows are spelled out word by word, so that a new effect needs no line here. A value that is not a
//! finite number is an en dash. Nothing here is escaped; that is the business of whoever writes it.

/// What stands where no number is.
pub(crate) const NOTHING: &str = "–";

/// Ids whose words alone would not say what they are.
const TITLES: &[(&str, &str)] = &[
    ("steer_rate", "steering rate limit"),
    ("steer_backlash", "steering play"),
    ("steer_saturation", "steering angle limit"),
    ("accel_jerk_limit", "jerk limit"),
    ("cmd_hold_rate", "held commands"),
    ("deadzone_accel", "pedal dead zone"),
    ("payload", "payload mass"),
    ("front_grip", "front tyre stiffness"),
    ("rear_grip", "rear tyre stiffness"),
    ("mu", "road friction"),
    ("drag_add", "added air drag"),
    ("roll_add", "added rolling resistance"),
    ("kinematic_only", "missing tyre slip"),
    ("grade", "road slope along"),
    ("bank", "road slope across"),
    ("wind_steady", "steady wind"),
    ("suspension_roll", "body roll"),
    ("ax_bias", "forward accelerometer zero"),
    ("ay_bias", "lateral accelerometer zero"),
    ("gyro_bias", "gyro zero"),
    ("wheel_scale", "wheel speed scale"),
    ("lever_arm", "reference point offset"),
    ("imu_misalignment", "IMU turned in its mount"),
    ("obs_latency", "observation latency"),
    ("jpeg_loss", "JPEG loss"),
    ("fog_haze", "fog or haze"),
    ("night_illumination", "night light"),
    ("tr_delay", "follower reaction time"),
    ("tr_headway", "follower headway"),
    ("tr_v0", "follower desired speed"),
    ("tr_accel", "follower acceleration"),
    ("tr_brake", "follower braking"),
    ("tr_min_gap", "follower gap at rest"),
];

/// Words that stand for parts of ids.
const PARTS: &[(&str, &str)] = &[
    ("steer", "steering"),
    ("accel", "drive"),
    ("cmd", "command"),
    ("cg", "centre of gravity"),
    ("imu", "IMU"),
    ("tr", "follower"),
    ("obs", "observation"),
];

/// Channels with their words and unit.
const CHANNELS: &[(&str, &str, &str)] = &[
    ("dx", "position along", "m"),
    ("dy", "position across", "m"),
    ("dyaw", "heading", "rad"),
    ("v", "speed", "m/s"),
    ("yaw_rate", "yaw rate", "rad/s"),
    ("ax", "acceleration forward", "m/s²"),
    ("ay", "acceleration left", "m/s²"),
    ("steer_meas", "steering position", "rad"),
    ("v_wheel", "wheel speed", "m/s"),
    ("agent_v", "follower speed", "m/s"),
    ("agent_gap", "follower gap", "m"),
    ("camera", "image", "grey levels"),
];

/// Returns an effect's name in words.
pub(crate) fn effect(id: &str) -> String {
    if let Some((_, title)) = TITLES.iter().find(|(known, _)| *known == id) {
        return (*title).to_owned();
    }
    let word = |part: &str| PARTS.iter().find(|(known, _)| *known == part).map_or(part.to_owned(), |p| p.1.to_owned());
    id.split('_').map(word).collect::<Vec<_>>().join(" ")
}

/// Returns a channel's name in words.
pub(crate) fn channel(id: &str) -> String {
    CHANNELS.iter().find(|c| c.0 == id).map_or_else(|| id.replace('_', " "), |c| c.1.to_owned())
}

/// Returns a metric's name in words and its unit.
pub(crate) fn metric(id: &str) -> (String, &'static str) {
    if let Some(name) = id.strip_prefix("channel:") {
        let unit = CHANNELS.iter().find(|c| c.0 == name).map_or("", |c| c.2);
        return (channel(name), unit);
    }
    if let Some(policy) = id.strip_prefix(ds_diagnosis::attended::METRIC) {
        return (format!("frames for {policy}"), "");
    }
    let after = |what: &str| {
        id.rsplit('_').next().map_or(what.to_owned(), |h| match h.strip_suffix('s') {
            Some(secs) if secs.parse::<f64>().is_ok() => format!("{what} after {secs} s"),
            _ => what.to_owned(),
        })
    };
    match id.split('_').next() {
        Some("position") => (after("position"), "m"),
        Some("yaw") => (after("heading"), "rad"),
        Some("speed") => (after("speed"), "m/s"),
        Some("image") => ("image difference".to_owned(), "grey levels"),
        _ => (id.replace('_', " "), ""),
    }
}

/// Returns a unit with proper signs; dimensionless is empty.
pub(crate) fn unit(unit: &str) -> String {
    match unit {
        "1" | "x" => String::new(),
        _ => unit.replace("^2", "²").replace("^3", "³"),
    }
}

/// Returns a capitalised text.
pub(crate) fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}

/// Joins words with commas and a last "and".
pub(crate) fn list(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [one] => one.clone(),
        [most @ .., last] => format!("{} and {last}", most.join(", ")),
    }
}

/// Returns a number with some decimals and a proper minus sign.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return NOTHING.to_owned();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().any(|c| c.is_ascii_digit() && c != '0') => format!("−{digits}"),
        Some(zero) => zero.to_owned(),
        None => text,
    }
}

/// Returns how many decimals show `digits` significant digits of a size, at most 6.
pub(crate) fn decimals(size: f64, digits: i32) -> usize {
    if !size.is_finite() || size == 0.0 {
        return 0;
    }
    (digits - 1 - size.abs().log10().floor() as i32).clamp(0, 6) as usize
}

/// Returns a number with three significant digits.
pub(crate) fn figure(value: f64) -> String {
    fixed(value, decimals(value, 3))
}

/// Returns numbers of one kind with the same decimals: two digits of the smallest, at most four of the largest.
pub(crate) fn aligned<const N: usize>(values: [f64; N]) -> [String; N] {
    let sizes = values.iter().map(|v| v.abs()).filter(|v| v.is_finite() && *v > 0.0);
    let (least, most) = sizes.fold((f64::INFINITY, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
    let count = decimals(least, 2).min(decimals(most, 4)).max(decimals(most, 2));
    values.map(|value| fixed(value, count))
}

/// An estimate with its interval, written with two digits of the interval's half width.
pub(crate) struct Estimate {
    /// The value and its unit.
    pub(crate) value: String,
    /// The interval in brackets, without unit.
    pub(crate) interval: String,
}

/// Writes an estimate; `None` where there is none (no finite value).
pub(crate) fn estimate(value: f64, [low, high]: [f64; 2], unit_id: &str) -> Option<Estimate> {
    if !value.is_finite() {
        return None;
    }
    let half = 0.5 * (high - low).abs();
    let wide = half.is_finite() && half > 0.0;
    let count =
        if wide { decimals(half, 2).min(decimals(value, 5).max(decimals(half, 1))) } else { decimals(value, 3) };
    let unit = unit(unit_id);
    let factor = if unit_id == "x" { "×\u{a0}" } else { "" };
    let space = if unit.is_empty() { "" } else { "\u{a0}" };
    Some(Estimate {
        value: format!("{factor}{}{space}{unit}", fixed(value, count)),
        interval: if wide { interval([low, high], count) } else { String::new() },
    })
}

/// Returns a probability in percent; the ends are never reached.
pub(crate) fn chance(p: f64) -> String {
    match p {
        p if !p.is_finite() => NOTHING.to_owned(),
        p if p >= 0.995 => ">\u{202f}99\u{a0}%".to_owned(),
        p if p < 0.005 => "<\u{202f}1\u{a0}%".to_owned(),
        p => format!("{:.0}\u{a0}%", 100.0 * p),
    }
}

/// Returns a share in percent.
pub(crate) fn share(value: f64) -> String {
    if value.is_finite() { format!("{}\u{a0}%", fixed(100.0 * value, 0)) } else { NOTHING.to_owned() }
}

/// Returns an interval in brackets, not to be broken into lines.
pub(crate) fn interval([low, high]: [f64; 2], decimals: usize) -> String {
    format!("[{},\u{a0}{}]", fixed(low, decimals), fixed(high, decimals))
}

/// Returns an interval of shares in percent.
pub(crate) fn shares(ends: [f64; 2]) -> String {
    interval(ends.map(|end| 100.0 * end), 0)
}

/// Returns a number with three significant digits and no zeros behind them.
pub(crate) fn plain(value: f64) -> String {
    let text = figure(value);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Returns a duration in a unit that suits it.
pub(crate) fn duration(secs: f64) -> String {
    match secs {
        s if !s.is_finite() => NOTHING.to_owned(),
        s if s < 0.95 => "<\u{202f}1 s".to_owned(),
        s if s < 9.5 => format!("{} s", fixed(s, 1)),
        s if s < 120.0 => format!("{} s", fixed(s, 0)),
        s if s < 7200.0 => format!("{} min", fixed(s / 60.0, 0)),
        s => format!("{} h", fixed(s / 3600.0, 0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_become_words() {
        for (id, words) in
            [("steer_delay", "steering delay"), ("mu", "road friction"), ("brand_new_thing", "brand new thing")]
        {
            assert_eq!(effect(id), words);
        }
        assert_eq!(metric("position_2s"), ("position after 2 s".to_owned(), "m"));
        assert_eq!(metric("channel:yaw_rate"), ("yaw rate".to_owned(), "rad/s"));
        assert_eq!(metric("driving_score"), ("driving score".to_owned(), ""));
        assert_eq!(list(&["a".to_owned(), "b".to_owned(), "c".to_owned()]), "a, b and c");
    }

    #[test]
    fn numbers_show_what_is_known() {
        for (value, interval, unit, expected) in [
            (0.1535, [0.1396, 0.1675], "s", "0.153 s [0.140, 0.168]"),
            (0.9768, [0.975, 0.9786], "x", "× 0.9768 [0.9750, 0.9786]"),
            (-212.4, [-290.0, -130.0], "kg", "−212 kg [−290, −130]"),
            (1.287, [1.211, 1.363], "m^2", "1.287 m² [1.211, 1.363]"),
            (0.2, [0.2, 0.2], "1", "0.200 "),
        ] {
            let found = estimate(value, interval, unit).expect("a finite value");
            assert_eq!(format!("{} {}", found.value, found.interval).replace('\u{a0}', " "), expected);
        }
        assert!(estimate(f64::NAN, [0.0, 1.0], "s").is_none());
        assert_eq!(aligned([24.07, 0.043, 0.04]), ["24.07", "0.04", "0.04"]);
        assert_eq!(aligned([0.53, f64::NAN, 0.041]), ["0.530", "–", "0.041"]);
    }

    #[test]
    fn ends_are_never_certain() {
        assert_eq!([1.0, 0.91, 0.0].map(chance), [">\u{202f}99\u{a0}%", "91\u{a0}%", "<\u{202f}1\u{a0}%"]);
        assert_eq!([share(-0.124), share(0.916), share(f64::NAN)], ["−12\u{a0}%", "92\u{a0}%", "–"]);
        assert_eq!([1.0, 0.25, 300.0].map(plain), ["1", "0.25", "300"]);
        assert_eq!([fixed(-0.0001, 2), fixed(f64::INFINITY, 1)], ["0.00", "–"]);
        assert_eq!([6.04, 36_000.0, 600.0, 0.01].map(duration), ["6.0 s", "10 h", "10 min", "<\u{202f}1 s"]);
    }
}
