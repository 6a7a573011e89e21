//! What can be wrong with a simulator that somebody else wrote.

/// Why a simulator cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SimulatorError {
    /// It cannot be started.
    #[error("simulator {command:?} cannot be started")]
    Start {
        /// The command.
        command: String,
        /// Why.
        source: std::io::Error,
    },
    /// It did not answer in time.
    #[error("simulator {command:?} gave no answer to {request} within {secs} s; it last said on stderr: {tail}")]
    Silent {
        /// The command.
        command: String,
        /// What was asked.
        request: &'static str,
        /// For how long.
        secs: u64,
        /// The last of its stderr.
        tail: String,
    },
    /// It ended.
    #[error("simulator {command:?} ended when asked for {request}; it last said on stderr: {tail}")]
    Ended {
        /// The command.
        command: String,
        /// What was asked.
        request: &'static str,
        /// The last of its stderr.
        tail: String,
    },
    /// It answered what is no answer.
    #[error("simulator answered {request} with {line:?}, which is no such reply: {why}")]
    Unreadable {
        /// What was asked.
        request: &'static str,
        /// The answer, cut.
        line: String,
        /// What is wrong with it.
        why: String,
    },
    /// It failed twice.
    #[error("simulator failed twice and is asked no more; the last failure: {why}")]
    GivenUp {
        /// The last failure.
        why: String,
    },
    /// It says other things of itself after a restart.
    #[error("simulator {command:?} describes itself differently after it was started anew")]
    Another {
        /// The command.
        command: String,
    },
    /// It refused a request.
    #[error("simulator refused {request}: {text}")]
    Refused {
        /// What was asked.
        request: &'static str,
        /// Its words.
        text: String,
    },
    /// It describes itself in a way that makes no sense, or lacks what is needed.
    #[error("simulator's hello has {field} = {value}, {expected} expected")]
    Hello {
        /// The field.
        field: String,
        /// Its value.
        value: String,
        /// What was expected.
        expected: &'static str,
    },
    /// A diagnosis has effects that it cannot be given.
    #[error("this simulator has neither a parameter nor a port for {effects}, which the diagnosis corrects")]
    Beyond {
        /// Their ids.
        effects: String,
    },
    /// It answered in no window of the drives.
    #[error("simulator answered in none of {windows} windows; the last reason: {why}")]
    NoWindow {
        /// How many were tried.
        windows: usize,
        /// The last failure.
        why: String,
    },
    /// The baseline is not one for the case.
    #[error(transparent)]
    Baseline(#[from] ds_diagnosis::CaseError),
    /// Standard input or output of a served simulator failed.
    #[error("read requests or write replies")]
    Stream(#[from] std::io::Error),
}
