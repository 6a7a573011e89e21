//! The channels of a recording: one per topic, and one per camera where a topic has cameras.
//!
//! A channel is named like the topic's key (`world`, `frame/front`); its metadata hold topic and camera index, so that
//! reading never parses names.

use std::collections::BTreeMap;

use ds_space::CameraId;
use ds_topic::Topic;

/// One channel: a topic, and the camera's index where there is one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ChannelKey {
    /// The topic.
    pub topic: Topic,
    /// The camera's index; 0 for topics without cameras.
    pub camera: u16,
}

impl ChannelKey {
    /// Returns all channels of an episode with some cameras, in topic and camera order.
    #[must_use]
    pub fn all(cameras: &[CameraId]) -> Vec<Self> {
        let count = u16::try_from(cameras.len()).unwrap_or(u16::MAX);
        let of_topic = |topic: Topic| {
            let last = if topic.per_camera() { count } else { 1 };
            (0..last).map(move |camera| Self { topic, camera })
        };
        Topic::ALL.into_iter().flat_map(of_topic).collect()
    }

    /// Returns the channel's name, such as `world` or `frame/front`.
    #[must_use]
    pub fn name(self, cameras: &[CameraId]) -> String {
        match cameras.get(usize::from(self.camera)).filter(|_| self.topic.per_camera()) {
            Some(camera) => format!("{}/{camera}", self.topic.name()),
            None => self.topic.name().to_owned(),
        }
    }

    pub(crate) fn metadata(self) -> BTreeMap<String, String> {
        let entry = |key: &str, value: String| (key.to_owned(), value);
        BTreeMap::from([entry("camera", self.camera.to_string()), entry("topic", self.topic.name().to_owned())])
    }

    pub(crate) fn from_metadata(metadata: &BTreeMap<String, String>) -> Option<Self> {
        let topic = Topic::from_name(metadata.get("topic")?)?;
        let camera = metadata.get("camera")?.parse().ok()?;
        Some(Self { topic, camera })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_camera_has_its_own_channels() {
        let cameras = ["front", "left"].map(|name| CameraId::new(name).expect("a plain word is an id"));
        let names: Vec<String> = ChannelKey::all(&cameras).into_iter().map(|key| key.name(&cameras)).collect();
        let expected = "scene advance world ego layout/front layout/left frame/front frame/left cache/front cache/left plan score event diagnosis";
        assert_eq!(names.join(" "), expected);
        for key in ChannelKey::all(&cameras) {
            assert_eq!(ChannelKey::from_metadata(&key.metadata()), Some(key));
        }
    }
}
