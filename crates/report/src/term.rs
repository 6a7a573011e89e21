//! What the short names of sub-metrics mean, for people.

/// Returns a title such as `drivable area` for `dac`; names it does not know keep their words.
#[must_use]
pub fn title(name: &str) -> String {
    let known = match name.to_ascii_lowercase().as_str() {
        "nc" | "collision" | "no_at_fault_collision" | "no_at_fault_collisions" => "collision",
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

/// Returns the title of a metric from its name in files.
#[must_use]
pub fn metric_title(metric: &str) -> String {
    title(metric.strip_prefix("sub_scores.").unwrap_or(metric))
}
