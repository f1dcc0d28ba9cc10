// Single-threaded replacement for oneTBB's header of this name.
#pragma once

#include <functional>
#include <memory>
#include <type_traits>
#include <utility>

namespace tbb {

/// The object is created on first use.
template <class T>
class enumerable_thread_specific {
  public:
    enumerable_thread_specific() : make_([] { return new T(); }) {}
    template <class Make>
    requires std::is_invocable_v<Make>
    explicit enumerable_thread_specific(Make make)
        : make_([make = std::move(make)] { return new T(make()); }) {}
    template <class Exemplar>
    requires(!std::is_invocable_v<Exemplar>) explicit enumerable_thread_specific(
        const Exemplar& exemplar)
        : make_([exemplar] { return new T(exemplar); }) {}

    T& local() {
        if (!object_) {
            object_.reset(make_());
        }
        return *object_;
    }
    void clear() { object_.reset(); }
    template <class Use>
    void combine_each(const Use& use) {
        if (object_) {
            use(*object_);
        }
    }
    T* begin() { return object_.get(); }
    T* end() { return object_ ? object_.get() + 1 : nullptr; }
    const T* begin() const { return object_.get(); }
    const T* end() const { return object_ ? object_.get() + 1 : nullptr; }

  private:
    std::function<T*()> make_;
    std::unique_ptr<T> object_;
};

}  // namespace tbb
