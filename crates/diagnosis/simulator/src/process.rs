//! A simulator as a process: requests to its standard input, replies from its standard output, one JSON object a line;
//! the last of its standard error is kept for error texts.
//!
//! Its command runs in a shell. A process that dies, keeps silent or talks nonsense is started once more; the request
//! that it failed at is lost. After a second failure it is asked no more: what it still says answers nothing.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crate::error::SimulatorError;
use crate::message::{Hello, Reply, Request, VERSION};

/// How long a reply may take, s.
const REPLY_SECS: u64 = 10;
/// How long the first one may take, for interpreters to start and code to be compiled, s.
const HELLO_SECS: u64 = 120;
/// Lines of standard error that are kept.
const TAIL: usize = 8;
/// Longest part of a reply that an error quotes.
const QUOTED: usize = 200;
/// Longest line that is read, bytes.
const LONGEST: u64 = 64 << 20;

/// A running simulator.
pub struct Process {
    /// What it said of itself.
    pub hello: Hello,
    command: String,
    /// None once it was given up.
    running: Option<Running>,
    restarted: bool,
    /// Why it was given up.
    why: String,
}

struct Running {
    child: Child,
    input: ChildStdin,
    lines: Receiver<String>,
    tail: Arc<Mutex<VecDeque<String>>>,
}

impl Drop for Running {
    fn drop(&mut self) {
        // it may have ended by itself
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

impl Process {
    /// Starts a simulator and asks what it is.
    ///
    /// # Errors
    /// If it cannot be started, does not answer, or is none that a diagnosis can work with.
    pub fn start(command: &str) -> Result<Self, SimulatorError> {
        let command = unit(command).unwrap_or_else(|| command.to_owned());
        let (running, hello) = Self::greet(&command)?;
        Ok(Self { hello, command, running: Some(running), restarted: false, why: String::new() })
    }

    fn greet(command: &str) -> Result<(Running, Hello), SimulatorError> {
        let mut running = Running::spawn(command)?;
        let line = running.ask(&Request::Hello(VERSION), HELLO_SECS, command)?;
        let hello: Hello = parse(&line, "hello")?;
        hello.check()?;
        Ok((running, hello))
    }

    /// Tells whether it was started anew.
    #[must_use]
    pub fn restarted(&self) -> bool {
        self.restarted
    }

    /// Asks for something. After a first failure of the process it is started once more, after a second it is ended; the
    /// failure is returned.
    ///
    /// # Errors
    /// If it refuses, keeps silent, ends, answers what is no reply, or was given up.
    pub fn ask(&mut self, request: &Request) -> Result<Reply, SimulatorError> {
        let Some(running) = &mut self.running else { return Err(SimulatorError::GivenUp { why: self.why.clone() }) };
        let answer = running.ask(request, REPLY_SECS, &self.command);
        match answer.and_then(|line| parse::<Reply>(&line, request.name())) {
            Ok(Reply::Error(failure)) => Err(SimulatorError::Refused { request: request.name(), text: failure.text }),
            Err(error) => {
                self.running = None;
                self.why = error.to_string();
                if !self.restarted {
                    self.restarted = true;
                    let (running, hello) = Self::greet(&self.command)?;
                    if hello != self.hello {
                        return Err(SimulatorError::Another { command: self.command.clone() });
                    }
                    self.running = Some(running);
                }
                Err(error)
            }
            answer => answer,
        }
    }
}

/// Returns the command that serves a functional mock-up unit, if that is what was named: foreign machine code runs in a process of
/// its own.
fn unit(command: &str) -> Option<String> {
    let path = command.trim();
    let alone = !path.contains(char::is_whitespace) || std::path::Path::new(path).is_file();
    let named = alone && path.to_ascii_lowercase().ends_with(".fmu");
    named.then(|| format!("python3 -m dreamstream.fmu '{}'", path.replace('\'', "'\\''")))
}

impl Drop for Process {
    fn drop(&mut self) {
        // who does not listen any more is ended all the same
        self.running.as_mut().and_then(|running| running.send(&Request::Bye(VERSION)).ok());
    }
}

impl Running {
    fn spawn(command: &str) -> Result<Self, SimulatorError> {
        let failed = |source| SimulatorError::Start { command: command.to_owned(), source };
        let mut child = Command::new("sh")
            .args(["-c", &format!("exec {command}")])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(failed)?;
        let pipes = (child.stdin.take(), child.stdout.take(), child.stderr.take());
        let (Some(input), Some(output), Some(complaints)) = pipes else {
            return Err(failed(std::io::Error::other("a pipe is missing")));
        };
        let (sender, lines) = sync_channel(4);
        std::thread::spawn(move || {
            let mut reader = BufReader::new(output);
            let mut line = String::new();
            while matches!(reader.by_ref().take(LONGEST).read_line(&mut line), Ok(count) if count > 0) {
                if sender.send(std::mem::take(&mut line)).is_err() {
                    break;
                }
            }
        });
        let tail = Arc::new(Mutex::new(VecDeque::new()));
        let kept = tail.clone();
        std::thread::spawn(move || {
            for line in BufReader::new(complaints).lines().map_while(Result::ok) {
                let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
                kept.push_back(line);
                if kept.len() > TAIL {
                    kept.pop_front();
                }
            }
        });
        Ok(Self { child, input, lines, tail })
    }

    fn send(&mut self, request: &Request) -> std::io::Result<()> {
        let mut line = serde_json::to_string(request)?;
        line.push('\n');
        self.input.write_all(line.as_bytes())?;
        self.input.flush()
    }

    fn ask(&mut self, request: &Request, secs: u64, command: &str) -> Result<String, SimulatorError> {
        let (command, name) = (command.to_owned(), request.name());
        if self.send(request).is_err() {
            return Err(SimulatorError::Ended { command, request: name, tail: self.tail() });
        }
        match self.lines.recv_timeout(Duration::from_secs(secs)) {
            Ok(line) => Ok(line),
            Err(RecvTimeoutError::Timeout) => {
                Err(SimulatorError::Silent { command, request: name, secs, tail: self.tail() })
            }
            Err(RecvTimeoutError::Disconnected) => {
                Err(SimulatorError::Ended { command, request: name, tail: self.tail() })
            }
        }
    }

    fn tail(&mut self) -> String {
        // what it says as it ends comes a moment later
        std::thread::sleep(Duration::from_millis(100));
        let tail = self.tail.lock().unwrap_or_else(PoisonError::into_inner);
        if tail.is_empty() { "nothing".to_owned() } else { tail.iter().cloned().collect::<Vec<_>>().join(" | ") }
    }
}

fn parse<T: serde::de::DeserializeOwned>(line: &str, request: &'static str) -> Result<T, SimulatorError> {
    serde_json::from_str(line).map_err(|error| {
        // a refusal may come where something else was expected
        if let Ok(Reply::Error(failure)) = serde_json::from_str(line) {
            return SimulatorError::Refused { request, text: failure.text };
        }
        let line = line.trim_end().chars().take(QUOTED).collect();
        SimulatorError::Unreadable { request, line, why: error.to_string() }
    })
}
