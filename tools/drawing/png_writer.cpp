#include "tools/drawing/png_writer.h"

#include <fmt/format.h>
#include <png.h>
#include <strings.h>

#include <csetjmp>
#include <exception>

#include <isonest/error.h>

#include "store/files/output_file.h"

namespace isonest::detail::cli {

struct PngFile::State {
    OutputFile file;
    std::uint64_t written = 0;
    std::exception_ptr failure;  ///< of the file, while libpng is on the stack
    png_structp png = nullptr;
    png_infop info = nullptr;

    explicit State(const std::filesystem::path& path) : file(path, true) {}
    State(const State&) = delete;
    State& operator=(const State&) = delete;
    ~State() { png_destroy_write_struct(&png, &info); }

    /// Whether the bytes are in the file; if not, `failure` says why.
    bool put(std::span<const std::byte> bytes) noexcept {
        try {
            file.write_at(written, bytes);
            written += bytes.size();
            return true;
        } catch (...) {
            failure = std::current_exception();
            return false;
        }
    }
    static void write(png_structp png, png_bytep data, png_size_t size) {
        if (!static_cast<State*>(png_get_io_ptr(png))->put(std::as_bytes(std::span(data, size)))) {
            png_error(png, "the file cannot be written");
        }
    }
};

namespace {

void no_warning(png_structp /*png*/, png_const_charp /*text*/) {}
void no_flush(png_structp /*png*/) {}

// libpng reports errors by a long jump: nothing here has a destructor.
// NOLINTBEGIN(modernize-avoid-setjmp-longjmp,cert-err52-cpp)
bool begin(png_structp png, png_infop info, void* state, png_rw_ptr write, int width, int height) {
    if (png == nullptr || info == nullptr || setjmp(png_jmpbuf(png)) != 0) {
        return false;
    }
    png_set_write_fn(png, state, write, no_flush);
    png_set_IHDR(png, info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), 8,
                 PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    return true;
}

bool write_row(png_structp png, const std::uint8_t* row) {
    if (setjmp(png_jmpbuf(png)) != 0) {
        return false;
    }
    png_write_row(png, row);
    return true;
}

bool end(png_structp png) {
    if (setjmp(png_jmpbuf(png)) != 0) {
        return false;
    }
    png_write_end(png, nullptr);
    return true;
}
// NOLINTEND(modernize-avoid-setjmp-longjmp,cert-err52-cpp)

}  // namespace

bool is_png(const std::filesystem::path& path) {
    const std::string end = path.extension().string();
    return ::strcasecmp(end.c_str(), ".png") == 0;
}

PngFile::PngFile(const std::filesystem::path& path, int width, int height)
    : path_(path),
      row_bytes_(3 * static_cast<std::size_t>(width)),
      state_(std::make_unique<State>(path)) {
    state_->png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, no_warning);
    state_->info = state_->png != nullptr ? png_create_info_struct(state_->png) : nullptr;
    if (!begin(state_->png, state_->info, state_.get(), &State::write, width, height)) {
        fail();
    }
}

PngFile::~PngFile() = default;

void PngFile::fail() {
    if (state_->failure != nullptr) {
        std::rethrow_exception(state_->failure);
    }
    throw Error(ErrorKind::limit, {path_.string()}, "cannot be encoded as PNG");
}

void PngFile::write(std::span<const std::uint8_t> rgb) {
    for (std::size_t at = 0; at < rgb.size(); at += row_bytes_) {
        if (!write_row(state_->png, rgb.data() + at)) {
            fail();
        }
    }
}

void PngFile::finish() {
    if (!end(state_->png)) {
        fail();
    }
    state_->file.publish_as_named();
}

}  // namespace isonest::detail::cli
