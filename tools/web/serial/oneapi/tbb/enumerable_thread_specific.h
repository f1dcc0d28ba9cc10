// As oneTBB's header of this name, for one thread.
#pragma once

#include <functional>
#include <optional>
#include <type_traits>
#include <utility>

namespace tbb {

/// The object is made when it is asked for.
template <class T>
class enumerable_thread_specific {
  public:
    enumerable_thread_specific() : make_([] { return T(); }) {}
    template <class Make>
    requires std::is_invocable_r_v<T, Make>
    explicit enumerable_thread_specific(Make make) : make_(std::move(make)) {}
    template <class Exemplar>
    requires(std::is_constructible_v<T, Exemplar> &&
             !std::is_invocable_r_v<
                 T, Exemplar>) explicit enumerable_thread_specific(const Exemplar& exemplar)
        : make_([exemplar] { return T(exemplar); }) {}

    T& local() {
        if (!object_) {
            object_.emplace(Made{make_});
        }
        return *object_;
    }
    template <class Use>
    void combine_each(const Use& use) {
        if (object_) {
            use(*object_);
        }
    }
    T* begin() { return object_ ? &*object_ : nullptr; }
    T* end() { return object_ ? &*object_ + 1 : nullptr; }

  private:
    /// What `make` returns is made in its place: a T need not be movable.
    struct Made {
        const std::function<T()>& make;
        operator T() const { return make(); }  // NOLINT(google-explicit-constructor)
    };

    std::function<T()> make_;
    std::optional<T> object_;
};

}  // namespace tbb
