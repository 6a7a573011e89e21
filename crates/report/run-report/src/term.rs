//! What the short names of sub-metrics mean, for people.
//!
//! Both the short names of the definitions (`nc`) and the long ones (`no_at_fault_collision`) are known.

/// Returns a title such as `drivable area` for `dac`; names it does not know keep their words.
#[must_use]
pub fn title(name: &str) -> String {
    let known = match name.to_ascii_lowercase().as_str() {
        "nc" | "no_at_fault_collision" | "no_at_fault_collisions" => "collision",
        "collision" => "physical contact",
        "dac" | "drivable_area" | "drivable_area_compliance" => "drivable area",
        "ddc" | "driving_direction" | "driving_direction_compliance" => "driving direction",
        "tlc" | "traffic_light" | "traffic_light_compliance" => "traffic light",
        "ep" | "progress" | "ego_progress" => "progress",
        "ttc" | "time_to_collision" => "time to collision",
        "lk" | "lane_keeping" => "lane keeping",
        "hc" | "history_comfort" => "history comfort",
        "ec" | "extended_comfort" => "extended comfort",
        "c" | "comfort" => "comfort",
        "driving_score" => "driving score",
        "route_completion" => "route completion",
        "mean_score" => "mean score",
        _ => return name.replace('_', " "),
    };
    known.to_owned()
}

/// Returns where a term stands among the others: multipliers, then weighted terms, as in the definition of the score;
/// names it does not know come last.
#[must_use]
pub fn rank(name: &str) -> usize {
    const ORDER: [&str; 10] = [
        "collision",
        "drivable area",
        "driving direction",
        "traffic light",
        "progress",
        "time to collision",
        "lane keeping",
        "history comfort",
        "extended comfort",
        "comfort",
    ];
    let title = title(name);
    ORDER.iter().position(|known| *known == title).unwrap_or(ORDER.len())
}

/// Says whether a term multiplies the score, so that breaking it costs everything: collision, drivable area, driving
/// direction, traffic light.
#[must_use]
pub fn is_constraint(name: &str) -> bool {
    rank(name) < 4
}

/// Returns the title of a metric from its name in files.
#[must_use]
pub fn metric_title(metric: &str) -> String {
    title(metric.strip_prefix("sub_scores.").unwrap_or(metric))
}
