// Checks a store against its volume, finds a flipped byte, compares two indicators, smooths the
// volume, and exports it.
#include <cmath>
#include <cstdio>
#include <fstream>
#include <random>
#include <vector>

#include <isonest/check.h>
#include <isonest/export_field.h>
#include <isonest/memory_volume.h>
#include <isonest/preprocess.h>
#include <isonest/smooth.h>
#include <isonest/study.h>

int main() {
    // A step of height 1 at x = 16, with noise.
    std::mt19937 random(1);
    std::vector<float> u;
    for (int i = 0; i < 33 * 33 * 33; ++i) {
        u.push_back((i % 33 < 16 ? 0.0F : 1.0F) +
                    0.05F * (static_cast<float>(random() % 2001) / 1000 - 1));
    }
    isonest::MemoryVolume volume(u.data(), {33, 33, 33});
    isonest::preprocess(
        volume, "step.isonest",
        {.force = true, .fields = {isonest::Field::linf_bar, isonest::Field::deviation_bar}});
    const isonest::Store store("step.isonest");

    const isonest::CheckReport good = isonest::check(store, {.source = &volume});
    std::printf("check: %zu findings\n", good.findings.size());

    const isonest::Study study =
        isonest::study(store, {.fields = {isonest::Field::linf_bar, isonest::Field::deviation_bar},
                               .steps = 5,
                               .least = 0.01});
    for (const isonest::StudyRow& row : study.rows) {
        std::printf("study: %s %.3g: %llu elements, error %.3g\n",
                    isonest::name_of(row.field).c_str(), row.threshold,
                    static_cast<unsigned long long>(row.leaves), row.norms.l2);
    }

    isonest::Smoothing smoothing(store, {.tau = 0.5, .lambda = 0.2});
    for (int step = 1; step <= 3; ++step) {
        const isonest::SmoothStep report = smoothing.step();
        std::printf("smooth: step %d, mean %.6f, variance %.6f\n", step, report.mean,
                    report.variance);
    }
    const auto at = [&](int x) {
        return static_cast<double>(
            smoothing.values()[static_cast<std::size_t>(x + 33 * (16 + 33 * 16))]);
    };
    std::printf("smooth: %.3f at the left of the step, %.3f at the right\n", at(14), at(17));

    const isonest::Int3 written =
        isonest::export_field(store, "half.npy", {.level = 1, .force = true});
    std::printf("export: %lld x %lld x %lld nodes\n", static_cast<long long>(written.x),
                static_cast<long long>(written.y), static_cast<long long>(written.z));

    // A byte in the middle of the file.
    {
        std::fstream file("step.isonest", std::ios::in | std::ios::out | std::ios::binary);
        file.seekg(0, std::ios::end);
        const auto middle = file.tellg() / 2;
        file.seekg(middle);
        const char byte = static_cast<char>(file.get() ^ 1);
        file.seekp(middle);
        file.put(byte);
    }
    const isonest::CheckReport bad = isonest::check(isonest::Store("step.isonest"));
    std::printf("check: %s\n", bad.failures > 0 ? bad.findings.front().test.c_str() : "nothing");
}
