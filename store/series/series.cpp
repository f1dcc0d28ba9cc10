// The index of a series (FORMAT.md, section 12).
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <system_error>
#include <utility>

#include <isonest/error.h>
#include <isonest/series.h>

#include "store/files/open_file.h"
#include "store/files/output_file.h"

namespace isonest {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kIndex = "series.json";
constexpr const char* kFormat = "isonest series";
constexpr int kVersion = 1;
constexpr std::uint64_t kMaxIndexBytes = std::uint64_t{256} << 20U;
constexpr std::size_t kMaxNameBytes = 255;

[[noreturn]] void corrupt(const std::filesystem::path& index, const std::string& problem,
                          const std::string& inside = {}) {
    throw Error(ErrorKind::corrupt, {index.string(), inside}, problem);
}

[[noreturn]] void fail(const std::filesystem::path& path, const char* what, int error) {
    throw Error(ErrorKind::io, {path.string()},
                fmt::format("cannot {}: {}", what, std::strerror(error)));
}

bool is_regular(const std::filesystem::path& path) {
    std::error_code ignored;
    return std::filesystem::is_regular_file(path, ignored);
}

/// Whether a name denotes a file in the folder itself.
bool is_plain_name(const std::string& name) {
    return !name.empty() && name.size() <= kMaxNameBytes && name != "." && name != ".." &&
           name.find('/') == std::string::npos && name.find('\0') == std::string::npos;
}

std::string text_of_file(const std::filesystem::path& path) {
    const detail::FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    if (file.get() < 0) {
        fail(path, "open", errno);
    }
    struct stat status {};
    if (::fstat(file.get(), &status) != 0) {
        fail(path, "read", errno);
    }
    const auto size = static_cast<std::uint64_t>(std::max<off_t>(status.st_size, 0));
    if (size > kMaxIndexBytes) {
        corrupt(path, fmt::format("is too large to be the index of a series: {} bytes", size));
    }
    std::string text(static_cast<std::size_t>(size), '\0');
    if (!detail::pread_whole(file.get(), 0, std::as_writable_bytes(std::span(text)))) {
        fail(path, "read", errno == 0 ? EIO : errno);
    }
    return text;
}

std::string text_in(const Json& object, const char* key, const std::filesystem::path& index,
                    const std::string& inside) {
    const auto found = object.find(key);
    if (found == object.end() || !found->is_string()) {
        corrupt(index, fmt::format("'{}' has to be a string", key), inside);
    }
    return found->get<std::string>();
}

SeriesStep step_of(const Json& json, const std::filesystem::path& index,
                   const std::string& inside) {
    if (!json.is_object()) {
        corrupt(index, "has to be an object", inside);
    }
    SeriesStep step;
    step.store = text_in(json, "store", index, inside);
    if (!is_plain_name(step.store)) {
        corrupt(
            index,
            fmt::format("'store' has to be the name of a file in the series' folder, not '{:.80}'",
                        step.store),
            inside);
    }
    const auto time = json.find("time");
    if (time == json.end() || !time->is_number()) {
        corrupt(index, "'time' has to be a number", inside);
    }
    step.time = time->get<double>();
    if (json.contains("source")) {
        step.source = text_in(json, "source", index, inside);
    }
    return step;
}

/// Closes the descriptor and throws, or returns the locked folder.
int locked(const std::filesystem::path& folder) {
    detail::FileDescriptor opened(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (opened.get() < 0) {
        fail(folder, "open", errno);
    }
    // On file systems that have no locks, the folder is not locked.
    if (::flock(opened.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
        throw Error(ErrorKind::io, {folder.string()},
                    "another run is adding steps to this series; wait until it has finished");
    }
    const int kept = ::fcntl(opened.get(), F_DUPFD_CLOEXEC, 0);
    if (kept < 0) {
        fail(folder, "open", errno);
    }
    return kept;
}

std::filesystem::path without_last_slash(std::filesystem::path path) {
    return path.has_filename() ? std::move(path) : path.parent_path();
}

}  // namespace

bool is_series(const std::filesystem::path& path) {
    return is_regular(path / kIndex);
}

Series::Series(std::filesystem::path folder) : folder_(without_last_slash(std::move(folder))) {
    const std::filesystem::path index = folder_ / kIndex;
    std::error_code ignored;
    if (!is_regular(index)) {
        const bool exists = std::filesystem::exists(folder_, ignored);
        throw Error(
            exists ? ErrorKind::invalid_argument : ErrorKind::not_found, {folder_.string()},
            exists ? fmt::format("is not a series: it has no {}", kIndex) : "does not exist");
    }
    Json json;
    try {
        json = Json::parse(text_of_file(index));
    } catch (const Json::exception& error) {
        corrupt(index, fmt::format("is not valid JSON ({:.200})", error.what()));
    }
    if (!json.is_object() || !json.contains("format") || json["format"] != kFormat) {
        corrupt(index,
                fmt::format("is not the index of a series: its 'format' is not '{}'", kFormat));
    }
    const auto version = json.find("version");
    if (version == json.end() || !version->is_number_integer() || *version < 1) {
        corrupt(index, "'version' has to be a whole number of at least 1");
    }
    if (*version > kVersion) {
        throw Error(
            ErrorKind::unsupported, {index.string()},
            fmt::format("has version {}; this program reads version {}", version->dump(), kVersion),
            {{RemedyKind::newer_version}});
    }
    const auto unit = json.find("time_unit");
    if (unit != json.end() && !unit->is_null()) {
        time_unit_ = text_in(json, "time_unit", index, "");
    }
    const auto steps = json.find("steps");
    if (steps == json.end() || !steps->is_array()) {
        corrupt(index, "'steps' has to be a list");
    }
    std::set<std::string> names;
    for (std::size_t i = 0; i < steps->size(); ++i) {
        const std::string inside = fmt::format("step {}", i);
        SeriesStep step = step_of((*steps)[i], index, inside);
        if (!steps_.empty() && !(step.time > steps_.back().time)) {
            corrupt(index,
                    fmt::format("its time, {}, is not later than that of the step before, {}",
                                step.time, steps_.back().time),
                    inside);
        }
        if (!names.insert(step.store).second) {
            corrupt(index, fmt::format("the store '{}' occurs twice", step.store), inside);
        }
        if (!is_regular(folder_ / step.store)) {
            throw Error(ErrorKind::not_found, {(folder_ / step.store).string()},
                        fmt::format("is missing ({} of the series, time {})", inside, step.time));
        }
        steps_.push_back(std::move(step));
    }
}

void require_no_series(const std::filesystem::path& path) {
    if (!is_series(path)) {
        return;
    }
    const Series series(path);
    throw Error(
        ErrorKind::invalid_argument, {path.string()},
        series.steps().empty()
            ? "is a series that has no steps yet"
            : fmt::format("is a series of {} stores, one for each step in time; give the "
                          "store of one step, such as {}",
                          series.steps().size(), series.store(series.steps().size() - 1).string()));
}

std::filesystem::path Series::store(std::size_t step) const {
    return folder_ / steps_.at(step).store;
}

SeriesWriter::SeriesWriter(Series series, int lock, bool is_new)
    : series_(std::move(series)), lock_(lock), is_new_(is_new) {}

SeriesWriter::SeriesWriter(SeriesWriter&& other) noexcept
    : series_(std::move(other.series_)),
      lock_(std::exchange(other.lock_, -1)),
      is_new_(std::exchange(other.is_new_, false)),
      made_folder_(other.made_folder_) {}

SeriesWriter::~SeriesWriter() {
    if (lock_ < 0) {
        return;
    }
    if (is_new_ && series_.steps_.empty()) {
        ::unlink((series_.folder_ / kIndex).c_str());
        if (made_folder_) {
            ::rmdir(series_.folder_.c_str());  // fails if an interrupted step is kept
        }
    }
    ::close(lock_);
}

SeriesWriter SeriesWriter::create(const std::filesystem::path& folder,
                                  const std::optional<std::string>& time_unit) {
    const std::filesystem::path path = without_last_slash(folder);
    const bool is_made = ::mkdir(path.c_str(), 0777) == 0;
    if (!is_made) {
        const int error = errno;
        if (error == ENOENT) {
            throw Error(ErrorKind::not_found, {path.parent_path().string()},
                        "the folder of the output does not exist");
        }
        if (error != EEXIST) {
            fail(path, "create the folder", error);
        }
        std::error_code failed;
        const std::filesystem::directory_iterator entries(path, failed);
        const bool is_free =
            !failed && std::all_of(begin(entries), end(entries), [](const auto& entry) {
                return entry.path().filename().native().starts_with('.');
            });
        if (!is_free) {
            throw Error(ErrorKind::invalid_argument, {path.string()},
                        is_series(path) ? "the series already exists"
                                        : "exists, and is not an empty folder",
                        {{RemedyKind::other_name}});
        }
    }
    SeriesWriter writer(Series(path, time_unit), locked(path), true);
    writer.made_folder_ = is_made;
    if (is_series(path)) {
        writer.is_new_ = false;  // another process was faster
        throw Error(ErrorKind::invalid_argument, {path.string()}, "the series already exists",
                    {{RemedyKind::other_name}});
    }
    writer.write();
    return writer;
}

SeriesWriter SeriesWriter::append(const std::filesystem::path& folder) {
    if (!is_series(folder)) {
        static_cast<void>(Series(folder));  // throws
    }
    // The index is read while the folder is locked.
    const int lock = locked(folder);
    try {
        return {Series(folder), lock, false};
    } catch (...) {
        ::close(lock);
        throw;
    }
}

std::filesystem::path SeriesWriter::next_store() const {
    const auto is_taken = [this](const std::string& name) {
        return std::any_of(series_.steps_.begin(), series_.steps_.end(),
                           [&](const SeriesStep& step) { return step.store == name; });
    };
    std::size_t number = series_.steps_.size();
    std::string name = fmt::format("step_{:06}.isonest", number);
    while (is_taken(name)) {
        name = fmt::format("step_{:06}.isonest", ++number);
    }
    return series_.folder_ / name;
}

void SeriesWriter::add(double time, const std::string& source) {
    const std::filesystem::path store = next_store();
    if (!std::isfinite(time)) {
        throw Error(ErrorKind::invalid_argument, {store.string()},
                    fmt::format("the time of a step has to be a finite number, not {}", time));
    }
    if (!series_.steps_.empty() && !(time > series_.steps_.back().time)) {
        throw Error(
            ErrorKind::invalid_argument, {series_.folder_.string()},
            fmt::format("a new step has to be later than the last one, at time {}; its time "
                        "is {}",
                        series_.steps_.back().time, time));
    }
    if (!is_regular(store)) {
        throw Error(ErrorKind::not_found, {store.string()}, "the store of the step is missing");
    }
    series_.steps_.push_back({store.filename().string(), time, source});
    try {
        write();
    } catch (...) {
        series_.steps_.pop_back();
        throw;
    }
}

void SeriesWriter::write() const {
    const auto line = [](const Json& json) {
        return json.dump(-1, ' ', false, Json::error_handler_t::replace);
    };
    std::string text =
        fmt::format("{{\"format\": \"{}\",\n \"version\": {},\n \"time_unit\": {},\n \"steps\": [",
                    kFormat, kVersion, series_.time_unit_ ? line(*series_.time_unit_) : "null");
    for (const SeriesStep& step : series_.steps_) {
        text += &step == series_.steps_.data() ? "\n  " : ",\n  ";
        text += line({{"store", step.store}, {"time", step.time}, {"source", step.source}});
    }
    text += "\n]}\n";
    detail::AppendedFile file(series_.folder_ / kIndex);
    file.add(std::as_bytes(std::span(text)));
    file.publish();
    // The names of the store and of the index are on disk before the next step begins.
    ::fsync(lock_);
}

}  // namespace isonest
