//! Standard output: what stands there is whole, or the exit code says that it is not.
//!
//! Three things can be wrong with it, and they differ. It was closed before the tool began (`>&-`), or the disk is full: what
//! was asked for is nowhere, an error as any other. Its reader went away, as `head` does when it has enough: no fault, but
//! neither is it all written. Tools in C end by SIGPIPE then, which shells report as 141, quietly; so does this one report it.

use std::io::{IsTerminal, StdoutLock, Write};
use std::process::ExitCode;

use crate::failure::{Failure, Outcome};
use crate::text::clean_lines;

#[cfg(unix)]
mod closed {
    use std::sync::atomic::{AtomicBool, Ordering};

    static CLOSED: AtomicBool = AtomicBool::new(false);

    // The standard library opens /dev/null in place of a closed standard output before `main`, and all writing succeeds: it
    // must be looked at before that. To look is all that is done: one system call.
    ctor::declarative::ctor! {
        #[ctor(unsafe)]
        fn look() {
            CLOSED.store(rustix::io::fcntl_getfd(rustix::stdio::stdout()).is_err(), Ordering::Relaxed);
        }
    }

    pub fn is_closed() -> bool {
        CLOSED.load(Ordering::Relaxed)
    }
}

#[cfg(not(unix))]
mod closed {
    /// The same as one that is discarded.
    pub fn is_closed() -> bool {
        false
    }
}

/// Standard output, if there is one.
pub fn lock() -> Result<StdoutLock<'static>, Failure> {
    if closed::is_closed() {
        let what =
            "standard output: is closed; open it, as by > FILE, or name an output with -o where the command has one";
        return Err(Failure::operation(what.into()));
    }
    Ok(std::io::stdout().lock())
}

/// Whether it shows what is written.
pub fn is_terminal() -> bool {
    !closed::is_closed() && std::io::stdout().is_terminal()
}

/// Prints text of several lines, in which no character steers the terminal.
pub fn print(text: &str) -> Outcome {
    print_as_is(&clean_lines(text))
}

/// Prints text that is this tool's own, escape sequences among it.
pub fn print_as_is(text: &str) -> Outcome {
    if text.is_empty() {
        return Ok(());
    }
    let mut out = lock()?;
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(|e| Failure::stdout(&e))
}

/// What clap says in place of a command line: help and the version on standard output, errors of usage on standard error. They
/// cite arguments, and those may be names of files (`csbrdf info *`).
pub fn clap(error: &clap::Error) -> ExitCode {
    if error.use_stderr() {
        let text = error.to_string();
        let cleaned = clean_lines(&text);
        let _ = match cleaned == text {
            true => error.print(),
            false => std::io::stderr().lock().write_all(cleaned.as_bytes()),
        };
        return ExitCode::from(error.exit_code().clamp(0, 255) as u8);
    }
    let printed = lock().and_then(|mut out| {
        // clap takes the lock too; it is the same thread's.
        error.print().and_then(|()| out.flush()).map_err(|e| Failure::stdout(&e))
    });
    match printed {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.report();
            ExitCode::from(failure.code())
        }
    }
}
