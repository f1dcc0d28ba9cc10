#include "preprocess/ranks/own_chunk_file.h"

#include <algorithm>

#include "store/files/shared_file.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kRowsAtOnce = 4096;
constexpr std::size_t kBytesAtOnce = std::size_t{1} << 20U;

}  // namespace

void OwnChunkFile::add(const EncodedChunk& chunk) {
    bytes_.write_at(end_, chunk.bytes);
    end_ += chunk.bytes.size();
    pending_.push_back(chunk.row);
    if (pending_.size() == kRowsAtOnce) {
        flush();
    }
}

void OwnChunkFile::flush() {
    rows_.write_at(count_ * sizeof(ChunkRow), std::as_bytes(std::span(pending_)));
    count_ += pending_.size();
    pending_.clear();
}

std::span<ChunkRow> OwnChunkFile::rows() {
    if (!pending_.empty() || rows_.as<ChunkRow>().size() != count_) {
        flush();
        rows_.map(count_ * sizeof(ChunkRow));
    }
    return rows_.as<ChunkRow>();
}

std::uint64_t OwnChunkFile::write_into(const std::filesystem::path& store) const {
    SharedFile file(store);
    std::vector<std::byte> buffer;
    std::uint64_t from = 0;
    const std::span<const ChunkRow> rows = rows_.as<ChunkRow>();
    for (std::size_t i = 0; i < rows.size();) {
        // As many chunks as lie one behind the other there, too.
        const std::uint64_t offset = rows[i].offset;
        std::uint64_t bytes = 0;
        for (; i < rows.size() && rows[i].offset == offset + bytes; ++i) {
            bytes += rows[i].bytes;
        }
        for (std::uint64_t done = 0; done < bytes;) {
            const std::uint64_t most = std::min<std::uint64_t>(bytes - done, kBytesAtOnce);
            std::uint64_t n = file.copy_from(bytes_.descriptor(), from, offset + done, most);
            if (n == 0) {
                buffer.resize(kBytesAtOnce);
                const auto piece = std::span(buffer).first(static_cast<std::size_t>(most));
                bytes_.read_at(from, piece);
                file.write_at(offset + done, piece);
                n = most;
            }
            from += n;
            done += n;
        }
    }
    file.close();
    return from;
}

}  // namespace isonest::detail
