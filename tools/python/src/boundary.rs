//! What stands between Python and the codec: exceptions, no unwinding, threads that survive a fork.

use std::any::Any;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process;
use std::sync::{Arc, Mutex, PoisonError, RwLock, RwLockWriteGuard};

use pyo3::exceptions::{PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::{ThreadPool, ThreadPoolBuilder};

pyo3::create_exception!(
    csbrdf,
    Error,
    PyValueError,
    "A file that cannot be read (no csbrdf file, another version, truncated, damaged, above a limit), or that does not \
     hold what was asked for."
);

/// The exception of an error: `OSError` (or its subclass) where the operating system refused, else `csbrdf.Error`.
pub fn exception(py: Python<'_>, error: codec::Error) -> PyErr {
    let codec::Error::Io(io) = error.kind() else { return Error::new_err(error.to_string()) };
    let Some(code) = io.raw_os_error() else { return PyOSError::new_err(error.to_string()) };
    let path = match &error {
        // Python's own functions put the path there as a str.
        codec::Error::InFile { path, .. } => Some(path.clone().into_os_string()),
        _ => None,
    };
    if cfg!(windows) {
        // The fourth is Windows' own number; Python finds errno by it.
        return PyOSError::new_err((0, io.to_string(), path, code));
    }
    let text = py.import("os").and_then(|os| os.call_method1("strerror", (code,))?.extract::<String>());
    PyOSError::new_err((code, text.unwrap_or_else(|_| io.to_string()), path))
}

/// Calls at work share it, a fork has it alone. A forked child has no other thread than the one that forked: what others had
/// locked, in this file, in a file's cache or anywhere below, would stay locked for ever. So a fork waits until no call is at
/// work, and calls that begin meanwhile wait for the fork.
static AT_WORK: RwLock<()> = RwLock::new(());

thread_local! {
    /// From before a fork until after it, in the thread that forks, which is the one that the child has.
    static FORKING: RefCell<Option<RwLockWriteGuard<'static, ()>>> = const { RefCell::new(None) };
}

/// Python calls it in the thread that is about to fork.
#[pyfunction]
fn before_fork(py: Python<'_>) {
    // Without the GIL: other threads may go on, and the calls that are waited for need it to return.
    py.detach(|| {
        let guard = AT_WORK.write().unwrap_or_else(PoisonError::into_inner);
        FORKING.with(|forking| *forking.borrow_mut() = Some(guard));
    });
}

/// Python calls it after a fork, in the parent and in the child.
#[pyfunction]
fn after_fork() {
    FORKING.with(|forking| drop(forking.borrow_mut().take()));
}

/// Has Python say when it forks; where it cannot, on Windows, it does not.
pub fn watch_forks(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let os = module.py().import("os")?;
    if !os.hasattr("register_at_fork")? {
        return Ok(());
    }
    let calls = PyDict::new(module.py());
    calls.set_item("before", wrap_pyfunction!(before_fork, module)?)?;
    calls.set_item("after_in_parent", wrap_pyfunction!(after_fork, module)?)?;
    calls.set_item("after_in_child", wrap_pyfunction!(after_fork, module)?)?;
    os.call_method("register_at_fork", (), Some(&calls)).map(drop)
}

/// Runs `work` without the GIL, and not while the process forks. A panic becomes a `RuntimeError`.
pub fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> codec::Result<T> + Send) -> PyResult<T> {
    // A panic leaves nothing half-done in a file: blocks enter its cache whole, its buffers are overwritten by the next
    // decode, and its lock is taken over if poisoned.
    let work = || {
        let _at_work = AT_WORK.read().unwrap_or_else(PoisonError::into_inner);
        catch_unwind(AssertUnwindSafe(work))
    };
    match py.detach(work) {
        Ok(result) => result.map_err(|e| exception(py, e)),
        Err(payload) => Err(PyRuntimeError::new_err(panic_message(&*payload))),
    }
}

fn panic_message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<String>().map(String::as_str).or(payload.downcast_ref::<&str>().copied());
    format!("a bug in csbrdf, please report it: {}", text.unwrap_or("no message"))
}

/// Runs `work` on this process's threads, within [`detached`]. rayon's global ones do not exist in a forked child, which would
/// wait for them for ever; `multiprocessing` forks.
pub fn on_threads<T: Send>(work: impl FnOnce() -> codec::Result<T> + Send) -> codec::Result<T> {
    pool()?.install(work)
}

fn pool() -> codec::Result<Arc<ThreadPool>> {
    static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    match &*pool {
        Some((owner, threads)) if *owner == process::id() => return Ok(threads.clone()),
        _ => {}
    }
    let name = |i| format!("csbrdf-{i}");
    let threads = ThreadPoolBuilder::new().thread_name(name).build().map_err(std::io::Error::other)?;
    let threads = Arc::new(threads);
    // The parent's is left as it is: its threads are not here to be ended.
    std::mem::forget(pool.replace((process::id(), threads.clone())));
    Ok(threads)
}
