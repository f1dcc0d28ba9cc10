// A program with names of 0.4.0 that have changed since. It has to compile for one release more,
// with a warning that gives the new name (examples_test.py). CHANGES.md lists what such a program
// has to change.
#include <cstdio>
#include <string>
#include <vector>

#include <isonest/extract.h>
#include <isonest/field.h>
#include <isonest/label_name.h>
#include <isonest/memory_volume.h>
#include <isonest/preprocess.h>
#include <isonest/remote.h>

int main() {
    const std::vector<float> values = [] {
        std::vector<float> made;
        for (int i = 0; i < 20 * 20 * 20; ++i) {
            const int x = i % 20 - 9, y = i / 20 % 20 - 9, z = i / 400 - 9;
            made.push_back(static_cast<float>(x * x + y * y + z * z));
        }
        return made;
    }();
    isonest::MemoryVolume volume(values.data(), {20, 20, 20});
    isonest::preprocess(volume, "ball.isonest", {.force = true});

    static_assert(isonest::LabelName::kMostBytes == 255 && isonest::LabelName::kMostOfStore > 0);
    static_assert(isonest::RemoteAccess::kLeastMemory > 0 && isonest::kMostIsovalues == 256);
    static_assert(isonest::MeshSink::kMostRows > 0 && isonest::LabelSmoothing::kMostPasses == 64);
    const isonest::Field field = isonest::Field::normal_component_bar;

    const isonest::Guarantee guarantee = isonest::Guarantee::plus;
    const isonest::TriangleBudget budget{600};
    const isonest::ErrorBudget error_budget{300};
    isonest::MeshCollector few;
    isonest::MeshCollector fewer;
    const isonest::Store store("ball.isonest");
    isonest::extract(store, isonest::SurfaceQuery{.iso = 50, .stop = budget}, few);
    isonest::extract(store, isonest::SurfaceQuery{.iso = 50, .stop = error_budget}, fewer);
    std::printf("%s %d %zu %zu\n", std::string(isonest::name_of(field)).c_str(),
                guarantee == isonest::ErrorIndicator::plus, few.triangles.size(),
                fewer.triangles.size());
}
