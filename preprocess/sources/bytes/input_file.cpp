#include "preprocess/sources/bytes/input_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <span>
#include <utility>

#include <isonest/error.h>

#include "store/container/codec.h"

namespace isonest::detail {

InputFile::InputFile(std::string url, std::shared_ptr<FarObjects> elsewhere)
    : url_(std::move(url)), elsewhere_(std::move(elsewhere)), bytes_(elsewhere_->open(url_)) {
    constexpr std::uint64_t kSample = std::uint64_t{1} << 16U;
    path_ = bytes_->name();
    const std::uint64_t size = bytes_->size();
    if (size == 0) {
        throw Error(ErrorKind::invalid_argument, {name()}, "the object is empty");
    }
    const std::uint64_t sample = std::min(size, kSample);
    std::vector<std::byte> ends;
    for (const std::uint64_t at : {std::uint64_t{0}, size - sample}) {
        const HeldBytes held = bytes_->read(at, sample);
        ends.insert(ends.end(), held.bytes().begin(), held.bytes().end());
    }
    if (!bytes_->version().empty()) {
        state_ = fmt::format("bytes {}, version {}, ends {:016x}", size, bytes_->version(),
                             checksum_of(ends));
    }
}

std::uint64_t InputFile::window() const {
    return std::min(elsewhere_->window(), bytes_->size());
}

InputFile InputFile::beside(const std::string& name) const {
    if (!is_far()) {
        return path_.parent_path() / name;
    }
    return {url_beside(url_, name, this->name()), elsewhere_};
}

std::vector<std::filesystem::path> local_files(const std::vector<InputFile>& files) {
    std::vector<std::filesystem::path> paths;
    for (const InputFile& file : files) {
        if (!file.is_far() && !file.empty()) {
            paths.push_back(file.path());
        }
    }
    return paths;
}

}  // namespace isonest::detail
