//! Metrics as the text that Prometheus reads (format 0.0.4): families sorted by name, each with meaning and kind.
//!
//! Samples of one family and equal labels are added up, so that services inside one process share one page.

use std::collections::BTreeMap;
use std::fmt::Write;

/// Upper bounds of the buckets of every histogram, in seconds; the last bucket has none.
const BOUNDS_SECS: [f64; 14] = [0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0];

/// What may become of a value from one scrape to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// It only grows while the process lives.
    Counter,
    /// It goes up and down.
    Gauge,
    /// Times, counted by how long they are.
    Histogram,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Counter => "counter",
            Self::Gauge => "gauge",
            Self::Histogram => "histogram",
        }
    }
}

/// Times in seconds, counted by how long they are.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Histogram {
    counts: [u64; BOUNDS_SECS.len() + 1],
    sum_secs: f64,
}

impl Histogram {
    /// Counts a time.
    pub fn observe(&mut self, secs: f64) {
        let bucket = BOUNDS_SECS.iter().position(|bound| secs <= *bound).unwrap_or(BOUNDS_SECS.len());
        self.counts[bucket] += 1;
        self.sum_secs += secs;
    }
}

struct Family {
    kind: Kind,
    help: &'static str,
    /// Names with labels, in order of first mention.
    samples: Vec<(String, f64)>,
}

/// One answer to a scrape.
#[derive(Default)]
pub struct Page(BTreeMap<String, Family>);

impl Page {
    /// Adds a value to the sample of a counter or gauge, by the family's name and the labels.
    pub fn tell(&mut self, name: &str, help: &'static str, kind: Kind, labels: &[(&str, &str)], value: f64) {
        let family = self.family(name, help, kind);
        family.add(format!("{name}{}", braced(labels)), value);
    }

    /// Adds the counts of a histogram.
    pub fn tell_times(&mut self, name: &str, help: &'static str, labels: &[(&str, &str)], times: &Histogram) {
        let family = self.family(name, help, Kind::Histogram);
        let mut count = 0;
        for (index, in_bucket) in times.counts.iter().enumerate() {
            count += in_bucket;
            let bound = BOUNDS_SECS.get(index).map_or("+Inf".to_owned(), f64::to_string);
            let labels = [labels, &[("le", bound.as_str())]].concat();
            family.add(format!("{name}_bucket{}", braced(&labels)), count as f64);
        }
        family.add(format!("{name}_sum{}", braced(labels)), times.sum_secs);
        family.add(format!("{name}_count{}", braced(labels)), count as f64);
    }

    fn family(&mut self, name: &str, help: &'static str, kind: Kind) -> &mut Family {
        self.0.entry(name.to_owned()).or_insert_with(|| Family { kind, help, samples: Vec::new() })
    }

    /// Returns the text.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (name, Family { kind, help, samples }) in &self.0 {
            let help = help.replace('\\', "\\\\").replace('\n', "\\n");
            let _infallible = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {}", kind.name());
            for (sample, value) in samples {
                let _infallible = writeln!(text, "{sample} {value}");
            }
        }
        text
    }
}

impl Family {
    fn add(&mut self, sample: String, value: f64) {
        match self.samples.iter_mut().find(|(known, _)| *known == sample) {
            Some((_, sum)) => *sum += value,
            None => self.samples.push((sample, value)),
        }
    }
}

/// Returns labels as they stand behind a name.
fn braced(labels: &[(&str, &str)]) -> String {
    let escaped = |value: &str| value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
    let labels: Vec<String> = labels.iter().map(|(name, value)| format!("{name}=\"{}\"", escaped(value))).collect();
    if labels.is_empty() { String::new() } else { format!("{{{}}}", labels.join(",")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads a page back by the rules of the format: each sample after its family's HELP and TYPE, labels unescaped.
    fn parsed(text: &str) -> BTreeMap<(String, Vec<(String, String)>), f64> {
        let (mut samples, mut family) = (BTreeMap::new(), String::new());
        for line in text.lines() {
            if let Some(told) = line.strip_prefix("# HELP ") {
                family = told.split(' ').next().expect("a name").to_owned();
            } else if let Some(told) = line.strip_prefix("# TYPE ") {
                assert_eq!(told.split(' ').next(), Some(family.as_str()), "{line}");
            } else {
                let (sample, value) = line.rsplit_once(' ').expect("a value");
                let (name, labels) = sample.split_once('{').unwrap_or((sample, "}"));
                assert!(name.starts_with(&family), "{line} stands in family {family}");
                let value = value.parse().expect("a number");
                let before = samples.insert((name.to_owned(), labels_of(labels)), value);
                assert_eq!(before, None, "{line} stands there twice");
            }
        }
        samples
    }

    fn labels_of(text: &str) -> Vec<(String, String)> {
        let (mut rest, mut labels) = (text, Vec::new());
        while let Some((name, quoted)) = rest.split_once("=\"") {
            let (mut value, mut letters) = (String::new(), quoted.chars());
            loop {
                match letters.next().expect("the value ends") {
                    '"' => break,
                    '\\' => value.push(match letters.next().expect("an escaped letter") {
                        'n' => '\n',
                        other => other,
                    }),
                    other => value.push(other),
                }
            }
            labels.push((name.to_owned(), value));
            rest = letters.as_str().trim_start_matches(',');
        }
        assert_eq!(rest, "}");
        labels
    }

    fn labelled(labels: &[(&str, &str)]) -> Vec<(String, String)> {
        labels.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect()
    }

    #[test]
    fn what_was_told_is_read_back() {
        let mut page = Page::default();
        let odd = [("role", "a \"b\"\\ c\nd, e}")];
        page.tell("z_total", "Last.\nSecond line.", Kind::Counter, &odd, 3.0);
        page.tell("z_total", "Last.", Kind::Counter, &odd, 4.0);
        page.tell("z_total", "Last.", Kind::Counter, &[("role", "other")], 1.0);
        page.tell("a", "First.", Kind::Gauge, &[], 0.25);
        let mut times = Histogram::default();
        [0.0, 0.001, 0.3, 99.0].into_iter().for_each(|secs| times.observe(secs));
        page.tell_times("times_seconds", "Times.", &[("role", "sim")], &times);
        page.tell_times("times_seconds", "Times.", &[("role", "sim")], &times);
        let text = page.text();
        let read = parsed(&text);
        let value = |name: &str, labels: &[(&str, &str)]| read[&(name.to_owned(), labelled(labels))];
        assert_eq!((value("z_total", &odd), value("z_total", &[("role", "other")]), value("a", &[])), (7.0, 1.0, 0.25));
        for (bound, count) in [("0.0005", 2.0), ("0.001", 4.0), ("0.25", 4.0), ("0.5", 6.0), ("10", 6.0), ("+Inf", 8.0)]
        {
            assert_eq!(value("times_seconds_bucket", &[("role", "sim"), ("le", bound)]), count, "{bound}\n{text}");
        }
        assert_eq!(value("times_seconds_count", &[("role", "sim")]), 8.0);
        assert!((value("times_seconds_sum", &[("role", "sim")]) - 198.602).abs() < 1e-9);
        assert!(text.starts_with("# HELP a First.\n# TYPE a gauge\na 0.25\n# HELP times_seconds "), "{text}");
    }
}
