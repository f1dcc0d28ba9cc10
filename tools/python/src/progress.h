// Long work from Python: without the GIL, with Ctrl-C and progress.
#pragma once

#include <pybind11/pybind11.h>

#include <functional>

#include <isonest/progress.h>

namespace isonest::python {

namespace py = pybind11;

/// Runs `work` on a thread of its own, while this one, without the GIL for most of the time, looks
/// after signals and calls `report(phase, done, total, unit)` (None: nothing) about ten times a
/// second, at the beginning of each phase and at the end of the last one. If a signal's handler or
/// `report` raises, the work is cancelled, and what was raised is thrown once it has ended; else
/// what the work throws. REQUIRES: the GIL is held.
void run_watched(const py::object& report, const std::function<void(Progress&)>& work);

/// Throws Error{cancelled} if work is running and all of it was cancelled: for waits of a store
/// that many may query at once. Thread-safe; without the GIL.
void check_running();

}  // namespace isonest::python
