//! Which field of which topic could be which channel: by message type where the type says it, else by the words of its name.

use ds_bags::Topic;

/// A field that could be a channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Candidate {
    pub channel: &'static str,
    pub topic: String,
    pub field: String,
    /// Further entries of the mapping.
    pub more: &'static str,
    /// How well it suits, the least best.
    pub rank: usize,
    /// Number of messages of its topic.
    pub messages: u64,
    /// Known by its name only.
    pub guessed: bool,
}

/// What a drive command that asks for a speed needs.
pub(super) const SPEED: &str = "kind = \"wheel_speed\"";

/// Type, channel, field and further entries, the best of a channel first. `*` stands for any package.
const BY_TYPE: &[(&str, &str, &str, &str)] = &[
    ("ackermann_msgs/AckermannDriveStamped", "cmd_steer", "drive.steering_angle", ""),
    ("ackermann_msgs/AckermannDriveStamped", "cmd_accel", "drive.acceleration", ""),
    ("*/Control", "cmd_steer", "lateral.steering_tire_angle", ""),
    ("*/Control", "cmd_accel", "longitudinal.acceleration", ""),
    ("*/AckermannControlCommand", "cmd_steer", "lateral.steering_tire_angle", ""),
    ("*/AckermannControlCommand", "cmd_accel", "longitudinal.acceleration", ""),
    ("ackermann_msgs/AckermannDrive", "cmd_steer", "steering_angle", ""),
    ("ackermann_msgs/AckermannDrive", "cmd_accel", "acceleration", ""),
    ("ackermann_msgs/AckermannDriveStamped", "cmd_accel", "drive.speed", SPEED),
    ("*/Control", "cmd_accel", "longitudinal.velocity", SPEED),
    ("*/AckermannControlCommand", "cmd_accel", "longitudinal.speed", SPEED),
    ("ackermann_msgs/AckermannDrive", "cmd_accel", "speed", SPEED),
    ("nav_msgs/Odometry", "x", "pose.pose.position.x", ""),
    ("nav_msgs/Odometry", "y", "pose.pose.position.y", ""),
    ("nav_msgs/Odometry", "yaw", "pose.pose.orientation", ""),
    ("geometry_msgs/PoseWithCovarianceStamped", "x", "pose.pose.position.x", ""),
    ("geometry_msgs/PoseWithCovarianceStamped", "y", "pose.pose.position.y", ""),
    ("geometry_msgs/PoseWithCovarianceStamped", "yaw", "pose.pose.orientation", ""),
    ("geometry_msgs/PoseStamped", "x", "pose.position.x", ""),
    ("geometry_msgs/PoseStamped", "y", "pose.position.y", ""),
    ("geometry_msgs/PoseStamped", "yaw", "pose.orientation", ""),
    ("sensor_msgs/NavSatFix", "x", "east", ""),
    ("sensor_msgs/NavSatFix", "y", "north", ""),
    ("sensor_msgs/Imu", "yaw", "orientation", ""),
    ("*/VelocityReport", "v", "longitudinal_velocity", ""),
    ("nav_msgs/Odometry", "v", "twist.twist.linear.x", ""),
    ("geometry_msgs/TwistWithCovarianceStamped", "v", "twist.twist.linear.x", ""),
    ("geometry_msgs/TwistStamped", "v", "twist.linear.x", ""),
    ("sensor_msgs/Imu", "yaw_rate", "angular_velocity.z", ""),
    ("*/VelocityReport", "yaw_rate", "heading_rate", ""),
    ("nav_msgs/Odometry", "yaw_rate", "twist.twist.angular.z", ""),
    ("geometry_msgs/TwistWithCovarianceStamped", "yaw_rate", "twist.twist.angular.z", ""),
    ("geometry_msgs/TwistStamped", "yaw_rate", "twist.angular.z", ""),
    ("sensor_msgs/Imu", "ax", "linear_acceleration.x", ""),
    ("sensor_msgs/Imu", "ay", "linear_acceleration.y", ""),
    ("geometry_msgs/AccelWithCovarianceStamped", "ax", "accel.accel.linear.x", ""),
    ("geometry_msgs/AccelWithCovarianceStamped", "ay", "accel.accel.linear.y", ""),
    ("geometry_msgs/AccelStamped", "ax", "accel.linear.x", ""),
    ("geometry_msgs/AccelStamped", "ay", "accel.linear.y", ""),
    ("*/SteeringReport", "steer_meas", "steering_tire_angle", ""),
];

/// Words by which a command is known from a measurement.
const COMMAND: &[&str] = &[
    "cmd",
    "command",
    "commanded",
    "commands",
    "request",
    "requested",
    "target",
    "desired",
    "setpoint",
    "control",
    "ctrl",
];

/// Returns every candidate of a topic.
pub(super) fn of(topic: &Topic) -> Vec<Candidate> {
    let Ok(leaves) = &topic.leaves else { return Vec::new() };
    let there = |field: &str| match field {
        "east" | "north" => leaves.iter().any(|leaf| leaf == "latitude"),
        _ => leaves.iter().any(|leaf| leaf == field || leaf.strip_suffix(".w") == Some(field)),
    };
    let made = |channel, field: &str, more, rank, guessed| Candidate {
        channel,
        topic: topic.name.clone(),
        field: field.to_owned(),
        more,
        rank,
        messages: topic.messages,
        guessed,
    };
    let asked = words(&topic.name).iter().any(|word| COMMAND.contains(&word.as_str()));
    if topic.kind.starts_with("geometry_msgs/Twist") && asked {
        let field = if there("twist.linear.x") { "twist.linear.x" } else { "linear.x" };
        return vec![made("cmd_accel", field, SPEED, BY_TYPE.len(), false)];
    }
    let is = |kind: &str| kind == topic.kind || kind.strip_prefix('*').is_some_and(|end| topic.kind.ends_with(end));
    let typed: Vec<Candidate> = BY_TYPE
        .iter()
        .enumerate()
        .filter(|(_, (kind, _, field, _))| is(kind) && there(field))
        .map(|(rank, (_, channel, field, more))| made(channel, field, more, rank, false))
        .collect();
    if !typed.is_empty() {
        return typed;
    }
    let guess = |leaf: &String| {
        let (channel, more) = by_words(&words(&format!("{}/{leaf}", topic.name)))?;
        Some(made(channel, leaf, more, BY_TYPE.len() + 1, true))
    };
    leaves.iter().filter(|leaf| !leaf.contains("stamp.")).filter_map(guess).collect()
}

/// Tells whether a topic is about pedals, which cannot be read.
pub(super) fn is_pedal(topic: &Topic) -> bool {
    words(&topic.name).iter().any(|word| ["pedal", "throttle", "brake"].contains(&word.as_str()))
}

/// Returns the channel that words tell of.
pub(super) fn by_words(words: &[String]) -> Option<(&'static str, &'static str)> {
    let any = |sought: &[&str]| words.iter().any(|word| sought.contains(&word.as_str()));
    let asked = any(COMMAND);
    if any(&["rate", "velocity", "speed"]) && any(&["steer", "steering"]) || any(&["covariance", "status", "valid"]) {
        return None;
    }
    match asked {
        true if any(&["steer", "steering"]) => Some(("cmd_steer", "")),
        true if any(&["accel", "acceleration"]) => Some(("cmd_accel", "")),
        true if any(&["force"]) => Some(("cmd_accel", "kind = \"force\"")),
        true if any(&["speed", "velocity"]) => Some(("cmd_accel", SPEED)),
        true => None,
        false if any(&["steer", "steering"]) => Some(("steer_meas", "")),
        false if any(&["yaw", "gyro"]) && any(&["rate", "z"]) => Some(("yaw_rate", "")),
        false if any(&["wheel", "wheels"]) && any(&["speed", "speeds", "velocity"]) => Some(("v_wheel", "")),
        false if any(&["speed", "velocity", "speedometer"]) && !any(&["angular", "lateral", "y", "z"]) => {
            Some(("v", ""))
        }
        false => None,
    }
}

/// Splits a name at its signs and where a capital follows a small letter.
pub(super) fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut small = false;
    for letter in name.chars() {
        if !letter.is_alphanumeric() || small && letter.is_uppercase() {
            words.push(String::new());
        }
        if let (true, Some(word)) = (letter.is_alphanumeric(), words.last_mut()) {
            word.extend(letter.to_lowercase());
        }
        small = letter.is_lowercase();
    }
    words.retain(|word| !word.is_empty());
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    fn topic(name: &str, kind: &str, leaves: &[&str]) -> Topic {
        let leaves = Ok(leaves.iter().map(|leaf| (*leaf).to_owned()).collect());
        Topic { name: name.to_owned(), kind: kind.to_owned(), messages: 9, received_nanos: None, leaves }
    }

    #[test]
    fn types_and_words_tell_what_a_field_is() {
        for (name, kind, leaf, expected) in [
            ("/vehicle/steering_cmd", "std_msgs/Float64", "data", Some("cmd_steer")),
            ("/vehicle/SteeringAngle", "std_msgs/Float64", "data", Some("steer_meas")),
            ("/can", "dbw_msgs/SteeringReport", "steering_tire_angle", Some("steer_meas")),
            ("/can", "own_msgs/Report", "steering_wheel_angle", Some("steer_meas")),
            ("/can", "own_msgs/Report", "steering_wheel_rate", None),
            ("/wheel_speed", "std_msgs/Float32", "data", Some("v_wheel")),
            ("/accel_target", "std_msgs/Float32", "data", Some("cmd_accel")),
            ("/cmd_vel", "geometry_msgs/Twist", "linear.x", Some("cmd_accel")),
            ("/velocity", "geometry_msgs/TwistStamped", "twist.linear.x", Some("v")),
            ("/battery", "std_msgs/Float32", "data", None),
            ("/image", "sensor_msgs/Image", "header.stamp.sec", None),
        ] {
            let found = of(&topic(name, kind, &[leaf]));
            assert_eq!(found.first().map(|c| c.channel), expected, "{name} {kind} {leaf}: {found:?}");
        }
    }
}
