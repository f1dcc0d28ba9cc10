// Which error a mesh may have so that it has at most so many triangles, learned from the meshes
// before: a slider moves on from where it was.
#pragma once

#include <cstdint>
#include <optional>

namespace isonest::detail::view {

/// Errors are steps of half an octave: step k is twice the range / 2^(k / 2), the step behind the
/// last is no error.
class ErrorChoice {
  public:
    /// `range`: of the data, >= 0.
    explicit ErrorChoice(double range) : range_(range) {}

    static constexpr int kMostStep = 48;

    /// One search: try(error) until there is nothing more to try.
    class Search {
      public:
        /// Once a mesh has few enough triangles, finer ones are tried for so many seconds.
        Search(const ErrorChoice& choice, std::uint64_t most, double seconds);
        /// The error of the next mesh; nothing if the best one is known.
        [[nodiscard]] std::optional<double> next() const;
        /// The mesh of next() has so many triangles and took so long.
        void tried(std::uint64_t triangles, double seconds);
        /// Of the best mesh so far: nothing if none had few enough.
        [[nodiscard]] std::optional<double> best() const;
        [[nodiscard]] int best_step() const { return best_; }

      private:
        const ErrorChoice* choice_;
        std::uint64_t most_;
        double seconds_;
        int step_;
        int best_ = -1;
        int too_fine_ = kMostStep + 2;  ///< the coarsest step that had too many
        double spent_ = 0;
        bool ended_ = false;
    };

    [[nodiscard]] double error(int step) const;
    /// What a search found is where the next one starts.
    void learn(const Search& search);

  private:
    double range_;
    int start_ = 8;
};

}  // namespace isonest::detail::view
