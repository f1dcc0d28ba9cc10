// Writes elements of the nested grid to a file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <isonest/element.h>
#include <isonest/store.h>

namespace isonest {

struct GridFileOptions {
    bool replace = false;  ///< whether to replace an existing regular file
    /// Names of numbers that are given with each element: cell data.
    std::vector<std::string> numbers = {};
};

/// A VTK unstructured grid (.vtu, XML with binary data in base64) of edges, triangles or tetrahedra
/// of a store. Positions are float64, in world units; point data "value" (float64) has U, NaN or
/// infinite where it is missing; cell data "level" (int32) has the elements' levels. Tetrahedra
/// have the orientation that VTK expects. The store's unit and frame are written as in .vtp files.
///
/// Elements are written as added, in pieces of up to 32,768, so memory does not grow with their
/// number (less than 16 MiB). A node is stored once in each piece that contains it; VTK joins the
/// pieces when it reads the file, but not the nodes (vtkStaticCleanUnstructuredGrid does). The same
/// elements in the same order give the same bytes.
///
/// The file appears under its name when close() returns; until then it has a temporary name, and
/// the destructor removes it. All functions throw Error{io}; the constructor also
/// Error{invalid_argument} if the file may not be written, its name does not end in ".vtu" or a
/// name of numbers is empty or has a character that XML reserves, and Error{not_found} if the
/// folder does not exist. Not thread-safe.
class GridFile {
  public:
    GridFile(const std::filesystem::path& path, const Store& store,
             const GridFileOptions& options = {});
    GridFile(const GridFile&) = delete;
    GridFile& operator=(const GridFile&) = delete;
    ~GridFile();

    /// Adds an element; all must have the same dimension. `numbers`: as many as
    /// GridFileOptions::numbers. Throws Error{invalid_argument} otherwise.
    template <int D>
    void add(const Element<D>& t, std::initializer_list<double> numbers = {}) {
        add(std::span<const Int3>(t.v), std::span<const double>(t.value), t.level,
            std::span<const double>(numbers.begin(), numbers.size()));
    }
    /// The number of elements so far.
    [[nodiscard]] std::uint64_t cells() const;
    /// Completes the file.
    void close();

  private:
    void add(std::span<const Int3> nodes, std::span<const double> values, int level,
             std::span<const double> numbers);

    class Writer;
    std::unique_ptr<Writer> writer_;
};

}  // namespace isonest
