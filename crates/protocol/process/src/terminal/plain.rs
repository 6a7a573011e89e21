//! Progress where stderr is no terminal, such as a log file: notes at once, how far the work is every half minute.

use std::fmt;
use std::io::{self, Write};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::TermLike;

/// Begins the line that tells how far the work is.
pub(super) const MARK: &str = "…";
const EVERY: Duration = Duration::from_secs(30);

/// Stands for a terminal: takes what would be drawn, writes what is worth a line of its own.
pub(super) struct Lines<W> {
    state: Mutex<State<W>>,
}

struct State<W> {
    out: W,
    drawn: Vec<String>,
    told: Instant,
}

impl<W: Write> Lines<W> {
    /// Writes to `out`, the first time after half a minute.
    pub(super) fn new(out: W) -> Self {
        Self { state: Mutex::new(State { out, drawn: Vec::new(), told: Instant::now() }) }
    }
}

impl<W> fmt::Debug for Lines<W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Lines")
    }
}

impl<W: Write + Send> TermLike for Lines<W> {
    fn width(&self) -> u16 {
        200
    }

    fn move_cursor_up(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_down(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_right(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_left(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn write_line(&self, text: &str) -> io::Result<()> {
        self.write_str(text)
    }

    fn write_str(&self, text: &str) -> io::Result<()> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.drawn.extend(Some(text.trim_end()).filter(|text| !text.is_empty()).map(str::to_owned));
        Ok(())
    }

    fn clear_line(&self) -> io::Result<()> {
        Ok(())
    }

    fn flush(&self) -> io::Result<()> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let due = state.told.elapsed() >= EVERY;
        for line in std::mem::take(&mut state.drawn) {
            if !line.starts_with(MARK) {
                writeln!(state.out, "{line}")?;
            } else if due {
                writeln!(state.out, "{line}")?;
                state.told = Instant::now();
            }
        }
        state.out.flush()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

    use super::*;

    /// What was written, still readable when a bar owns the writer.
    #[derive(Clone, Default)]
    struct Shared(Arc<Mutex<Vec<u8>>>);

    impl Write for Shared {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().expect("one thread").write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn shown(told: Instant) -> String {
        let out = Shared::default();
        let lines = Lines { state: Mutex::new(State { out: out.clone(), drawn: Vec::new(), told }) };
        let bar = ProgressBar::with_draw_target(Some(10), ProgressDrawTarget::term_like(Box::new(lines)));
        bar.set_style(ProgressStyle::with_template("… {pos}/{len}").expect("a template"));
        bar.set_position(3);
        bar.println("a note");
        bar.println("another");
        bar.finish_and_clear();
        let written = out.0.lock().expect("one thread").clone();
        String::from_utf8(written).expect("text")
    }

    #[test]
    fn notes_are_written_at_once_and_progress_when_due() {
        assert_eq!(shown(Instant::now()), "a note\nanother\n");
        let long_ago = Instant::now().checked_sub(2 * EVERY).expect("a machine that runs for a minute");
        assert_eq!(shown(long_ago), "… 3/10\na note\nanother\n");
    }
}
