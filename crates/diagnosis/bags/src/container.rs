//! The three containers, one file each, as one stream of topics and messages.
//!
//! A rosbag2 bag may be a folder of several files, read in the order of their numbers. Messages of topics that nobody
//! wants are skipped where the container allows it. Definitions that a bag does not hold are looked for beside it. Index and order of a file are not relied upon.

mod beside;
mod mcap_file;
mod rosbag1;
mod rosbag2;

use std::path::{Path, PathBuf};

use crate::definition::Wire;
use crate::error::BagError;

/// Most bytes of a message, a chunk or a definition.
pub(crate) const MAX_BYTES: usize = 128 << 20;
/// Most topics of a bag.
pub(crate) const MAX_TOPICS: usize = 4_096;

/// Kind of container.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// MCAP with ROS 2 or ROS 1 messages.
    Mcap,
    /// ROS 1 bag, version 2.0.
    Rosbag1,
    /// SQLite file of rosbag2.
    Rosbag2,
}

/// A topic as its container declares it.
#[derive(Debug, Clone)]
pub(crate) struct Declared {
    /// Its name.
    pub name: String,
    /// Type of its messages, as written.
    pub kind: String,
    /// How its messages are written.
    pub wire: Wire,
    /// Text of their definition; what stands in the way where there is none.
    pub definition: Result<String, String>,
}

/// One message.
pub(crate) struct Message<'a> {
    /// Number of its topic, as the container has it; unique within a file.
    pub topic: u32,
    /// When it was received, ns.
    pub log_nanos: i64,
    /// When it was sent, ns, where the container says so.
    pub publish_nanos: Option<i64>,
    /// Its bytes.
    pub data: &'a [u8],
}

/// What is made of a stream of messages.
pub(crate) trait Sink {
    /// Begins another file: numbers of topics count anew.
    fn begin(&mut self, path: &Path);
    /// Takes a topic; tells whether its messages are wanted.
    fn topic(&mut self, number: u32, declared: Declared) -> Result<bool, BagError>;
    /// Takes a message of a wanted topic.
    fn message(&mut self, message: &Message<'_>) -> Result<(), BagError>;
}

/// A sink whose topics without a definition get that of the `.msg` files beside the bag.
struct Completed<'a> {
    sink: &'a mut dyn Sink,
    folder: &'a Path,
}

impl Sink for Completed<'_> {
    fn begin(&mut self, path: &Path) {
        self.sink.begin(path);
    }

    fn topic(&mut self, number: u32, mut declared: Declared) -> Result<bool, BagError> {
        if let Err(why) = &declared.definition {
            declared.definition =
                beside::definition(self.folder, &declared.kind).map_err(|lacks| format!("{why}; {lacks}"));
        }
        self.sink.topic(number, declared)
    }

    fn message(&mut self, message: &Message<'_>) -> Result<(), BagError> {
        self.sink.message(message)
    }
}

impl Format {
    /// Returns the format of a file by its first bytes, of a folder by the files in it.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn of(path: &Path) -> Result<Option<Self>, BagError> {
        use std::io::Read as _;
        let failed = |source| BagError::Read { path: path.to_path_buf(), source };
        if path.is_dir() {
            let inside = [Self::Mcap, Self::Rosbag2].into_iter().find(|f| f.files(path).is_ok_and(|f| !f.is_empty()));
            return Ok(inside);
        }
        let mut first = Vec::new();
        std::fs::File::open(path).map_err(failed)?.take(16).read_to_end(&mut first).map_err(failed)?;
        let magics: [(&[u8], Self); 3] =
            [(mcap::MAGIC, Self::Mcap), (rosbag1::MAGIC, Self::Rosbag1), (b"SQLite format 3\0", Self::Rosbag2)];
        Ok(magics.into_iter().find(|(magic, _)| first.starts_with(magic)).map(|(_, format)| format))
    }

    /// Reads a bag into a sink.
    pub(crate) fn read(self, path: &Path, sink: &mut dyn Sink) -> Result<(), BagError> {
        for file in self.files(path)? {
            sink.begin(&file);
            let mut sink = Completed { sink: &mut *sink, folder: file.parent().unwrap_or(Path::new(".")) };
            match self {
                Self::Mcap => mcap_file::read(&file, &mut sink)?,
                Self::Rosbag1 => rosbag1::read(&file, &mut sink)?,
                Self::Rosbag2 => rosbag2::read(&file, &mut sink)?,
            }
        }
        Ok(())
    }

    /// Returns the files of a bag.
    fn files(self, path: &Path) -> Result<Vec<PathBuf>, BagError> {
        if !path.is_dir() {
            return Ok(vec![path.to_path_buf()]);
        }
        let failed = |source| BagError::Read { path: path.to_path_buf(), source };
        let ending = match self {
            Self::Mcap => "mcap",
            Self::Rosbag1 => "bag",
            Self::Rosbag2 => "db3",
        };
        let mut files = Vec::new();
        for entry in std::fs::read_dir(path).map_err(failed)? {
            let file = entry.map_err(failed)?.path();
            if file.extension().is_some_and(|e| e == ending) {
                files.push(file);
            }
        }
        // drive_2.db3 stands before drive_10.db3
        files.sort_by_key(|file| {
            let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let digits = stem.len() - stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
            (stem[stem.len() - digits..].parse::<u64>().unwrap_or(0), stem)
        });
        if files.is_empty() {
            let source = std::io::Error::new(std::io::ErrorKind::NotFound, format!("no .{ending} file in this folder"));
            return Err(failed(source));
        }
        Ok(files)
    }
}
