//! Who may say what on a bus that is reached over a network: mutual TLS, and rights by the name in the certificate.
//!
//! Every service may listen, ask and answer pulls; each may put its own topics alone, and only the orchestrator answers for
//! the journal. Those who look on (`viewer`, `gap`) listen and ask; `gap` may put its diagnosis and nothing else.
//! Certificates that name none of the [`STATIONS`] may do nothing.

use std::path::PathBuf;

use ds_topic::Topic;

use crate::keys::{all_alive, all_journal_pulls, all_pulls, all_pushes};

/// The files of one end of a TLS link, PEM.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TlsFiles {
    /// The authority that both ends trust.
    pub ca: PathBuf,
    /// The own certificate; its common name says who one is.
    pub certificate: PathBuf,
    /// The key to it.
    pub key: PathBuf,
}

impl TlsFiles {
    /// Returns Zenoh's `transport/link/tls`.
    pub(crate) fn config(&self) -> serde_json::Value {
        serde_json::json!({
            "root_ca_certificate": self.ca,
            "listen_certificate": self.certificate,
            "listen_private_key": self.key,
            "connect_certificate": self.certificate,
            "connect_private_key": self.key,
            "enable_mtls": true,
            "verify_name_on_connect": true,
        })
    }
}

/// The services by the common names of their certificates, with the topics that they put.
pub const STATIONS: [(&str, &[Topic]); 7] = [
    ("orchestrator", &[Topic::Scene, Topic::Advance, Topic::Score, Topic::Event]),
    ("sim-server", &[Topic::World, Topic::Ego, Topic::Event]),
    ("layout-render", &[Topic::Layout, Topic::Event]),
    ("vdm-worker", &[Topic::Frame, Topic::Cache, Topic::Event]),
    ("policy-bridge", &[Topic::Plan, Topic::Event]),
    ("gap", &[Topic::Diagnosis]),
    ("viewer", &[]),
];
/// The stations that have no part in an episode.
const ONLOOKERS: [&str; 2] = ["gap", "viewer"];

/// Returns Zenoh's `access_control` of the router between the services.
pub(crate) fn rights() -> serde_json::Value {
    let rule = |id: &str, messages: &[&str], flows: &[&str], keys: Vec<String>| serde_json::json!({"id": id, "permission": "allow", "messages": messages, "flows": flows, "key_exprs": keys});
    let both = ["ingress", "egress"];
    let mut rules = vec![
        rule("listen", &["declare_subscriber"], &both, Topic::ALL.into_iter().map(all_pushes).collect()),
        rule("hear", &["put"], &["egress"], Topic::ALL.into_iter().map(all_pushes).collect()),
        rule("pull", &["query"], &both, vec![all_pulls(), all_journal_pulls()]),
        rule("hold", &["declare_queryable", "reply"], &["ingress"], vec![all_pulls()]),
        rule("held", &["declare_queryable", "reply"], &["egress"], vec![all_pulls(), all_journal_pulls()]),
        rule("journal", &["declare_queryable", "reply"], &["ingress"], vec![all_journal_pulls()]),
        rule(
            "live",
            &["liveliness_token", "declare_liveliness_subscriber", "liveliness_query", "reply"],
            &both,
            vec![all_alive()],
        ),
    ];
    let mut subjects = Vec::new();
    let mut policies = Vec::new();
    for (station, topics) in STATIONS {
        let mut granted = vec!["listen", "hear", "pull", "held", "live"];
        if !ONLOOKERS.contains(&station) {
            granted.push("hold");
        }
        let tell = format!("tell-{station}");
        if !topics.is_empty() {
            let keys = topics.iter().copied().map(all_pushes).collect();
            rules.push(rule(&tell, &["put"], &["ingress"], keys));
            granted.push(&tell);
        }
        if station == "orchestrator" {
            granted.push("journal");
        }
        subjects.push(serde_json::json!({"id": station, "cert_common_names": [station]}));
        policies.push(serde_json::json!({"rules": granted, "subjects": [station]}));
    }
    serde_json::json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_topic_is_put_by_somebody_and_only_events_by_many() {
        for topic in Topic::ALL {
            let who: Vec<&str> =
                STATIONS.iter().filter(|(_, topics)| topics.contains(&topic)).map(|(name, _)| *name).collect();
            assert!(who.len() == 1 || (topic == Topic::Event && who.len() == 5), "{topic:?} is put by {who:?}");
        }
    }

    #[test]
    fn who_looks_on_answers_no_pull_and_puts_a_diagnosis_at_most() {
        let rights = rights();
        let list = |key: &str| rights[key].as_array().cloned().expect("a list");
        for station in ONLOOKERS {
            let policy = list("policies").into_iter().find(|policy| policy["subjects"][0] == station);
            let granted = policy.and_then(|policy| policy["rules"].as_array().cloned()).expect("a policy");
            assert!(!granted.iter().any(|rule| *rule == "hold" || *rule == "journal"), "{station} may {granted:?}");
            for rule in list("rules").iter().filter(|rule| granted.contains(&rule["id"])) {
                let ingress = rule["flows"].as_array().is_some_and(|flows| flows.iter().any(|flow| *flow == "ingress"));
                let puts = rule["messages"].as_array().is_some_and(|all| all.iter().any(|message| *message == "put"));
                let diagnosis = serde_json::json!([all_pushes(Topic::Diagnosis)]);
                assert!(!(ingress && puts) || rule["key_exprs"] == diagnosis, "{station} may {rule}");
            }
        }
    }

    #[test]
    fn zenoh_takes_the_rights() {
        let mut config = zenoh::Config::default();
        config.insert_json5("access_control", &rights().to_string()).expect("the rights are a configuration");
        let files = TlsFiles { ca: "ca.pem".into(), certificate: "a.pem".into(), key: "a.key".into() };
        config.insert_json5("transport/link/tls", &files.config().to_string()).expect("so are the files");
    }
}
