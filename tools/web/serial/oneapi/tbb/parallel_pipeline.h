// Single-threaded replacement for oneTBB's header of this name: each item passes through all
// filters before the next one starts.
#pragma once

#include <cstddef>
#include <type_traits>
#include <utility>

namespace tbb {

enum class filter_mode { parallel, serial_in_order };

class flow_control {
  public:
    void stop() { is_stopped_ = true; }
    [[nodiscard]] bool is_stopped() const { return is_stopped_; }

  private:
    bool is_stopped_ = false;
};

/// A filter from In to Out; void at the ends.
template <class In, class Out, class Body>
struct filter {
    Body body;
};

template <class In, class Out, class Body>
auto make_filter(filter_mode /*mode*/, const Body& body) {
    return filter<In, Out, Body>{body};
}

template <class Middle, class Out, class First, class Second>
auto operator&(const filter<void, Middle, First>& first,
               const filter<Middle, Out, Second>& second) {
    const auto both = [first, second](flow_control& control) -> Out {
        Middle item = first.body(control);
        if (control.is_stopped()) {
            return Out();
        }
        return second.body(std::move(item));
    };
    return filter<void, Out, std::decay_t<decltype(both)>>{both};
}

template <class Body>
void parallel_pipeline(std::size_t /*most*/, const filter<void, void, Body>& all) {
    flow_control control;
    while (!control.is_stopped()) {
        all.body(control);
    }
}

}  // namespace tbb
