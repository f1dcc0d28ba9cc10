// Runs long work for Python: without the GIL, interruptible by Ctrl-C, with progress.
#pragma once

#include <pybind11/pybind11.h>

#include <functional>

#include <isonest/progress.h>

namespace isonest::python {

namespace py = pybind11;

/// Runs `work` on another thread. Meanwhile this thread, mostly without the GIL, handles signals
/// and calls `report(phase, done, total, unit)` (None: not at all): about ten times per second, at
/// the start of each phase, and at the end of the last one. If a signal handler or `report` raises,
/// the work is cancelled, and the exception is thrown when the work has ended. Otherwise throws
/// what `work` throws. REQUIRES: the GIL is held.
void run_watched(const py::object& report, const std::function<void(Progress&)>& work);

/// Throws Error{cancelled} if work is running and all of it has been cancelled. A store calls it
/// while it waits for the network, because many threads may query one store. Thread-safe; does not
/// need the GIL.
void check_running();

}  // namespace isonest::python
