// A chunk source that writes down which chunks are decoded: for tests and programs that measure.
#pragma once

#include <map>
#include <mutex>
#include <span>

#include "store/container/wrapping/forwarding_source.h"

namespace isonest::detail {

class RecordingSource : public ForwardingSource {
  public:
    using ForwardingSource::ForwardingSource;
    void decode(const ArrayInfo& array, const Int3& chunk,
                std::span<std::byte> raw) const override {
        source().decode(array, chunk, raw);
        const std::lock_guard lock(mutex_);
        ++decoded_[array.row_of(chunk)];
    }
    /// How often each was decoded, by row of the chunk table. REQUIRES: no decode() at the same
    /// time.
    [[nodiscard]] const std::map<std::uint64_t, int>& decoded() const { return decoded_; }

  private:
    mutable std::mutex mutex_;
    mutable std::map<std::uint64_t, int> decoded_;
};

}  // namespace isonest::detail
