#include "preprocess/ranks/own_chunk_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>

#include <isonest/error.h>

#include "store/files/read_at.h"
#include "store/files/shared_file.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kRowsAtOnce = 4096;
constexpr std::size_t kBytesAtOnce = std::size_t{1} << 20U;

/// From one file into another.
void copy_chunks(ChunkRun from, const SharedFile& to, std::uint64_t offset, std::uint64_t bytes,
                 std::vector<std::byte>& buffer, const std::filesystem::path& store) {
    while (bytes > 0) {
        const std::uint64_t most = std::min<std::uint64_t>(bytes, kBytesAtOnce);
        std::uint64_t n = to.copy_from(from.descriptor, from.offset, offset, most);
        if (n == 0) {
            buffer.resize(kBytesAtOnce);
            const auto piece = std::span(buffer).first(static_cast<std::size_t>(most));
            if (!pread_whole(from.descriptor, from.offset, piece)) {
                throw Error(ErrorKind::io, {store.string()},
                            fmt::format("cannot read chunks of it back: {}",
                                        errno == 0 ? "the file was cut" : std::strerror(errno)));
            }
            to.write_at(offset, piece);
            n = most;
        }
        from.offset += n;
        offset += n;
        bytes -= n;
    }
}

}  // namespace

void OwnChunkFile::add(std::span<const EncodedChunk> chunks) {
    const ChunkRun place{bytes_.descriptor(), end_};
    for (const EncodedChunk& chunk : chunks) {
        bytes_.write_at(end_, chunk.bytes);
        end_ += chunk.bytes.size();
    }
    add(chunks, place);
}

void OwnChunkFile::add(std::span<const EncodedChunk> chunks, const ChunkRun& place) {
    if (runs_.empty() || runs_.back().place.descriptor != place.descriptor ||
        runs_.back().place.offset + runs_.back().bytes != place.offset) {
        runs_.push_back({place});
    }
    for (const EncodedChunk& chunk : chunks) {
        ++runs_.back().rows;
        runs_.back().bytes += chunk.row.bytes;
        pending_.push_back(chunk.row);
        if (pending_.size() == kRowsAtOnce) {
            flush();
        }
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
    std::uint64_t written = 0;
    std::span<const ChunkRow> rows = rows_.as<ChunkRow>();
    for (const Run& run : runs_) {
        ChunkRun from = run.place;
        const std::span<const ChunkRow> of_run = rows.first(run.rows);
        rows = rows.subspan(run.rows);
        for (std::size_t i = 0; i < of_run.size();) {
            // As many chunks as lie one behind the other there, too.
            const std::uint64_t offset = of_run[i].offset;
            std::uint64_t bytes = 0;
            for (; i < of_run.size() && of_run[i].offset == offset + bytes; ++i) {
                bytes += of_run[i].bytes;
            }
            copy_chunks(from, file, offset, bytes, buffer, store);
            from.offset += bytes;
        }
        written += run.bytes;
    }
    file.close();
    return written;
}

}  // namespace isonest::detail
