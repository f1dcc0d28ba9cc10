// An interrupted run, when resumed, gives the same bytes as an uninterrupted one.
#include "preprocess/levels/resume.h"

#include <hdf5.h>

#include <catch2/catch.hpp>
#include <cmath>

#include <isonest/error.h>
#include <isonest/open_volume.h>

#include "store/container/reader.h"
#include "store/files/output_file.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// Cancels at the n-th call.
class CancelAt : public Progress {
  public:
    explicit CancelAt(int n) : left_(n) {}
    [[nodiscard]] bool cancelled() const override { return --left_ < 0; }

  private:
    mutable std::atomic<int> left_;
};

/// Like a gzip stream: can only be read in order, and from the start in each run.
class Sequential : public FunctionVolume<float> {
  public:
    using FunctionVolume<float>::FunctionVolume;
    [[nodiscard]] bool sequential() const override { return true; }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        REQUIRE(z0 == next_);
        next_ = z0 + nz;
        FunctionVolume<float>::read(z0, nz, y0, ny, dst);
    }
    std::int64_t next_ = 0;
};

float uneven(const Int3& p) {
    return static_cast<float>(smooth(p) + 0.1 * noise(p));
}

PreprocessOptions resuming(int chunk = 8) {
    PreprocessOptions options = with_chunk(chunk);
    options.resume = true;
    options.threads = 1;
    return options;
}

/// Returns whether the run was cancelled.
bool interrupted(VolumeSource& source, const std::filesystem::path& store, int questions,
                 const PreprocessOptions& options) {
    CancelAt progress(questions);
    try {
        preprocess(source, store, options, progress);
    } catch (const Error& error) {
        REQUIRE(error.kind() == ErrorKind::cancelled);
        return true;
    }
    return false;
}

std::filesystem::path leftover(const TemporaryFolder& folder, const std::string& end) {
    for (const std::string& name : folder.names()) {
        const bool plain = !name.ends_with(".journal") && !name.ends_with(".centres");
        if (name.starts_with(".s.partial-") && name.ends_with(end) && (!end.empty() || plain)) {
            return folder / name.c_str();
        }
    }
    return {};
}

}  // namespace

TEST_CASE("a run interrupted anywhere and resumed gives the same bytes, and leaves no other file") {
    FunctionVolume<float> volume({70, 41, 75}, uneven);
    const TemporaryFolder folder;
    make_store(volume, folder / "whole", with_chunk(8));
    const std::string whole = read_file(folder / "whole");
    std::filesystem::remove(folder / "whole");
    std::uint64_t most = 0;
    for (int questions = 3; questions < 400; questions = questions * 5 / 4 + 1) {
        CAPTURE(questions);
        const bool cancelled = interrupted(volume, folder / "s", questions, resuming());
        CHECK(cancelled != std::filesystem::exists(folder / "s"));
        if (!cancelled) {
            break;
        }
        const PreprocessReport r = preprocess(volume, folder / "s", resuming(), silent_progress());
        CHECK(r.resumed_chunks >= most);
        most = r.resumed_chunks;
        CHECK(read_file(folder / "s") == whole);
        CHECK(folder.names() == std::vector<std::string>{"s"});
        std::filesystem::remove(folder / "s");
    }
    CHECK(most > 500);
}

TEST_CASE("a resumed run keeps chunks that are not shuffled") {
    FunctionVolume<float> volume({70, 41, 75}, [](const Int3& p) {  // 8 bits in 32
        return static_cast<float>(std::floor(200 * noise(p)) / 255);
    });
    const TemporaryFolder folder;
    make_store(volume, folder / "whole", with_chunk(8));
    REQUIRE(interrupted(volume, folder / "s", 60, resuming()));
    const PreprocessReport r = preprocess(volume, folder / "s", resuming(), silent_progress());
    CHECK(r.resumed_chunks > 50);
    CHECK(read_file(folder / "s") == read_file(folder / "whole"));
    const StoreReader store(folder / "s");
    const ArrayInfo& values = store.layout().array(0, Field::values);
    CHECK((store.row(values, {0, 0, 0}).flags & kChunkUnshuffled) != 0);
}

TEST_CASE("a run that is interrupted repeatedly completes in the end") {
    FunctionVolume<float> volume({70, 41, 75}, uneven);
    const TemporaryFolder folder;
    make_store(volume, folder / "whole", with_chunk(8));
    int runs = 1;
    // Each time a little longer, because finished parts must be read again.
    while (interrupted(volume, folder / "s", 20 * runs, resuming())) {
        const std::size_t left = folder.names().size() - 1;
        CHECK((left == 0 || left == 3));
        REQUIRE(++runs < 300);
    }
    CHECK(runs > 3);
    CHECK(read_file(folder / "s") == read_file(folder / "whole"));
    CHECK(folder.names().size() == 2);
}

TEST_CASE("a resumed run recomputes what it finds damaged") {
    FunctionVolume<float> volume({50, 41, 120}, uneven);
    const TemporaryFolder folder;
    make_store(volume, folder / "whole", with_chunk(8));
    for (const char* end : {"", ".journal", ".centres"}) {
        for (const double place : {0.1, 0.5, 0.9}) {
            for (const bool cut : {false, true}) {
                CAPTURE(end, place, cut);
                REQUIRE(interrupted(volume, folder / "s", 120, resuming()));
                const std::filesystem::path file = leftover(folder, end);
                REQUIRE(!file.empty());
                std::string bytes = read_file(file);
                const auto at = static_cast<std::size_t>(place * static_cast<double>(bytes.size()));
                if (cut) {
                    bytes.resize(at);
                } else {
                    bytes[at] = static_cast<char>(bytes[at] ^ 0x41);
                }
                std::ofstream(file, std::ios::binary) << bytes;
                preprocess(volume, folder / "s", resuming(), silent_progress());
                CHECK(read_file(folder / "s") == read_file(folder / "whole"));
                for (const std::string& name : folder.names()) {
                    if (name != "whole") {
                        std::filesystem::remove(folder / name.c_str());
                    }
                }
            }
        }
    }
}

TEST_CASE("a stream is read from its beginning when its run is resumed") {
    const TemporaryFolder folder;
    Sequential first({50, 41, 120}, uneven);
    make_store(first, folder / "whole", with_chunk(8));
    Sequential second({50, 41, 120}, uneven);
    REQUIRE(interrupted(second, folder / "s", 120, resuming()));
    Sequential third({50, 41, 120}, uneven);
    CHECK(preprocess(third, folder / "s", resuming(), silent_progress()).resumed_chunks > 0);
    CHECK(read_file(folder / "s") == read_file(folder / "whole"));
}

TEST_CASE("a resumed run reads only the planes that are not finished") {
    FunctionVolume<float> volume({50, 41, 120}, uneven);
    const TemporaryFolder folder;
    REQUIRE(interrupted(volume, folder / "s", 60, resuming()));
    volume.planes_read_ = 0;
    CHECK(preprocess(volume, folder / "s", resuming(), silent_progress()).resumed_chunks > 0);
    CHECK(volume.planes_read_ < 100);
    CHECK(volume.planes_read_ > 0);
}

TEST_CASE("files left for another input or other options are not used, but named") {
    FunctionVolume<float> volume({50, 41, 120}, uneven);
    const TemporaryFolder folder;
    REQUIRE(interrupted(volume, folder / "s", 120, resuming()));
    const auto names = folder.names();
    const auto message = [&](const PreprocessOptions& options) {
        try {
            preprocess(volume, folder / "s", options, silent_progress());
        } catch (const Error& error) {
            CHECK(error.kind() == ErrorKind::invalid_argument);
            return std::string(error.what());
        }
        return std::string();
    };
    const std::string chunks = message(resuming(16));
    CHECK(chunks.find("'chunk 8'") != std::string::npos);
    CHECK(chunks.find("'chunk 16'") != std::string::npos);
    PreprocessOptions other = resuming();
    volume.identity_ = "input 2\n";
    const std::string inputs = message(other);
    CHECK(inputs.find("'input 1'") != std::string::npos);
    CHECK(inputs.find("'input 2'") != std::string::npos);
    // Without --resume they are not touched.
    other.resume = false;
    CHECK(message(other).empty());
    CHECK(std::filesystem::exists(folder / "s"));
    for (const std::string& name : names) {
        CHECK(std::filesystem::exists(folder / name.c_str()));
    }
}

TEST_CASE(
    "a run is not resumed if the values differ although the identity of the input is the same") {
    for (const bool first : {true, false}) {
        FunctionVolume<float> volume({50, 41, 120}, uneven);
        const TemporaryFolder folder;
        REQUIRE(interrupted(volume, folder / "s", 120, resuming()));
        const auto names = folder.names();
        FunctionVolume<float> other({50, 41, 120}, [&](const Int3& p) {
            return uneven(p) + (p.x == 49 && p.y == 40 && (p.z == 0) == first ? 1.0F : 0.0F);
        });
        try {
            preprocess(other, folder / "s", resuming(), silent_progress());
            FAIL("not noticed");
        } catch (const Error& error) {
            CHECK(error.kind() == ErrorKind::invalid_argument);
            CHECK(error.problem().find("the input has changed") != std::string::npos);
            CHECK((error.place().inside == "plane 0") == first);
            CHECK(error.remedies() == std::vector<Remedy>{{RemedyKind::no_resume}});
        }
        CHECK(folder.names() == names);
        preprocess(volume, folder / "s", resuming(), silent_progress());
        make_store(volume, folder / "whole", with_chunk(8));
        CHECK(read_file(folder / "s") == read_file(folder / "whole"));
    }
}

TEST_CASE(
    "the identity of a source distinguishes each of its files, even with the same size and time") {
    const TemporaryFolder folder;
    const auto write = [&](const char* name, const auto& fill) {
        const hid_t file =
            H5Fcreate((folder / name).c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
        fill(file);
        H5Fclose(file);
    };
    const auto write_data = [&](const char* name, int first) {
        write(name, [&](hid_t file) {
            const std::array<hsize_t, 3> dims{4, 5, 6};
            std::vector<int> values(120, first);
            const hid_t space = H5Screate_simple(3, dims.data(), nullptr);
            const hid_t data =
                H5Dcreate2(file, "v", H5T_STD_I32LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
            H5Dwrite(data, H5T_NATIVE_INT, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
            H5Dclose(data);
            H5Sclose(space);
        });
    };
    write_data("target.h5", 3);
    const auto link = [&](const char* to) {
        return [&folder, to](hid_t file) {
            H5Lcreate_external((folder / to).c_str(), "/v", file, "v", H5P_DEFAULT, H5P_DEFAULT);
        };
    };
    write("middle.h5", link("target.h5"));
    write("main.h5", link("middle.h5"));
    SourceOptions options;
    options.dataset = "v";
    const auto identity = [&] { return open_volume(folder / "main.h5", options)->identity(); };
    CHECK(open_volume(folder / "main.h5", options)->files().size() == 3);
    const std::string before = identity();
    CHECK(identity() == before);
    for (const char* const name : {"target.h5", "middle.h5", "main.h5"}) {
        const auto time = std::filesystem::last_write_time(folder / name);
        std::filesystem::last_write_time(folder / name, time + std::chrono::nanoseconds(1));
        CHECK(identity() != before);
        std::filesystem::last_write_time(folder / name, time);
        CHECK(identity() == before);
    }
    const auto time = std::filesystem::last_write_time(folder / "target.h5");
    write_data("target.h5", 4);
    std::filesystem::last_write_time(folder / "target.h5", time);
    CHECK(identity() != before);
    options.missing = 3;
    CHECK(identity().find("missing 3") != std::string::npos);
}

TEST_CASE("without --resume an interrupted run leaves no file") {
    FunctionVolume<float> volume({50, 41, 120}, uneven);
    const TemporaryFolder folder;
    PreprocessOptions options = resuming();
    options.resume = false;
    REQUIRE(interrupted(volume, folder / "s", 120, options));
    CHECK(folder.names().empty());
}

TEST_CASE("a run that is still alive is not taken over, even if the name is the same") {
    FunctionVolume<float> volume({30, 30, 60}, uneven);
    const TemporaryFolder folder;
    REQUIRE(interrupted(volume, folder / "s", 40, resuming()));
    const std::filesystem::path store = leftover(folder, "");
    const RunJournal alive(store, "another\n");  // replaces and locks the journal
    CHECK(!InterruptedRun::find(folder / "s", "another\n").has_value());
    CHECK(temporary_name(folder / "s") != store);
}

TEST_CASE("the files of an interrupted run are taken over by one process at a time") {
    const TemporaryFolder folder;
    RunJournal(folder / ".s.partial-7", "same\n").keep();
    std::optional<InterruptedRun> first = InterruptedRun::find(folder / "s", "same\n");
    REQUIRE(first.has_value());
    CHECK(!InterruptedRun::find(folder / "s", "same\n").has_value());
    first.reset();
    CHECK(InterruptedRun::find(folder / "s", "same\n").has_value());
}
