// A series: a folder with one store for each step in time, and an index with their times.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace isonest {

struct SeriesStep {
    std::string store;  ///< name of the store's file in the folder of the series
    double time = 0;    ///< in the series' unit of time; finite
    /// What identifies the volume that the store was made from; compared only with other texts of
    /// the same writer. May be empty.
    std::string source = {};
};

/// The index of a series, as it was when it was read. A run that adds steps replaces the index
/// after each step, so all steps that the index lists are complete. Thread-safety: const methods
/// from any thread.
class Series {
  public:
    /// Reads the index and checks that the stores are there; opens none of them. Throws
    /// Error{not_found} (no folder, no index, a store is missing), Error{invalid_argument} (not a
    /// series), Error{corrupt}, Error{unsupported} (a later version), Error{io}.
    explicit Series(std::filesystem::path folder);

    [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
    /// The unit of the times as the input spells it, such as "s" or "hours since 2020-01-01";
    /// nullopt if it is unknown.
    [[nodiscard]] const std::optional<std::string>& time_unit() const { return time_unit_; }
    /// By ascending times, each of which occurs once; may be empty.
    [[nodiscard]] const std::vector<SeriesStep>& steps() const { return steps_; }
    /// The path of a step's store. REQUIRES: step < steps().size().
    [[nodiscard]] std::filesystem::path store(std::size_t step) const;

  private:
    friend class SeriesWriter;
    Series(std::filesystem::path folder, std::optional<std::string> time_unit)
        : folder_(std::move(folder)), time_unit_(std::move(time_unit)) {}

    std::filesystem::path folder_;
    std::optional<std::string> time_unit_;
    std::vector<SeriesStep> steps_;
};

/// Whether this is a folder with the index of a series, valid or not. Never throws.
bool is_series(const std::filesystem::path& path);
/// For functions that work on one store: throws Error{invalid_argument} if this is a series; the
/// message names one of its stores.
void require_no_series(const std::filesystem::path& path);

/// Adds steps to a series. Only one process at a time can: the folder is locked until the writer is
/// destroyed. Thread-safety: one thread.
class SeriesWriter {
  public:
    /// Begins a series: creates the folder. If it exists, it must contain nothing but hidden files.
    /// Throws Error{invalid_argument, not_found, io}.
    static SeriesWriter create(const std::filesystem::path& folder,
                               const std::optional<std::string>& time_unit = {});
    /// Continues a series. Throws what Series throws, and Error{io} if it is locked.
    static SeriesWriter append(const std::filesystem::path& folder);
    SeriesWriter(SeriesWriter&& other) noexcept;
    SeriesWriter(const SeriesWriter&) = delete;
    SeriesWriter& operator=(const SeriesWriter&) = delete;
    /// Removes a new series that has no steps.
    ~SeriesWriter();

    [[nodiscard]] const Series& series() const { return series_; }
    /// Where the store of the next step is to be written. A file of that name is not part of the
    /// series, and may be replaced.
    [[nodiscard]] std::filesystem::path next_store() const;
    /// Adds the finished store next_store() to the index, which is replaced in one step. Throws
    /// Error{invalid_argument} unless `time` is finite and later than the last step's,
    /// Error{not_found} if there is no such store, Error{io}.
    void add(double time, const std::string& source);

  private:
    SeriesWriter(Series series, int lock, bool is_new);
    void write() const;

    Series series_;
    int lock_;
    bool is_new_;
    bool made_folder_ = false;
};

}  // namespace isonest
