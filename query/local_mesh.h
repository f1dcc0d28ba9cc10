// The part of the surface that one thread makes in one go, before vertices are welded across parts.
#pragma once

#include <tsl/robin_map.h>

#include <array>
#include <cstdint>
#include <vector>

#include "query/vertex_attributes.h"
#include "query/vertex_key.h"
#include "store/int3.h"

namespace isonest {

/// A corner of a tetrahedron that is marched.
struct Corner {
    Int3 node;     ///< on the finest lattice
    double value;  ///< REQUIRES: finite
};

/// A box in coordinates of the finest lattice, to which the surface is cut.
struct ClipBox {
    Double3 lo{};
    Double3 hi{};
};

/// A finished part: vertices in the order in which the triangles first name them.
struct MeshPart {
    static constexpr std::uint32_t kNoVertex = 0xFFFFFFFFU;

    /// A vertex (or, without one, a link between other parts' vertices) that other parts may share.
    struct Shared {
        std::uint32_t vertex = kNoVertex;
    };
    /// A name of shared element `shared`. Elements of any part with an equal name are one vertex.
    struct Name {
        VertexKey key;
        std::uint32_t shared = 0;
    };
    /// A vertex where the box cuts a triangle edge whose ends are both shared. Equal ends and plane
    /// in another part mean the same vertex.
    struct Cut {
        std::uint32_t end0 = 0;  ///< shared elements
        std::uint32_t end1 = 0;
        std::uint32_t plane = 0;
        std::uint32_t shared = 0;  ///< the element of the cut vertex itself
    };
    std::vector<Double3> positions;  ///< coordinates of the finest lattice
    std::vector<float> attributes;   ///< as many per vertex as were asked for
    std::vector<std::array<std::uint32_t, 3>> triangles;
    std::vector<Shared> shared;  ///< those with a vertex in ascending order of it
    std::vector<Name> names;
    std::vector<Cut> cuts;
};

/// Collects triangles of marched tetrahedra. Not thread-safe; one per thread, reused.
class LocalMesh {
  public:
    LocalMesh() = default;
    /// With attributes of the vertices; `attributes` must outlive the mesh.
    /// `single_sheet`: the surface never touches itself (a plane), so that a node on it is one
    /// vertex, and a face in it one triangle.
    explicit LocalMesh(AttributeSampler* attributes, bool single_sheet = false)
        : attributes_(attributes), single_sheet_(single_sheet) {}

    /// Marches one leaf tetrahedron: a node is inside if value >= iso; the triangles' normals point
    /// to the smaller values. Where the surface passes exactly through nodes, no triangle of zero
    /// area arises and the mesh stays a manifold. `cut` says that the tetrahedron may reach out of
    /// the box. `positive`: det(v1 - v0, v2 - v0, v3 - v0) > 0.
    void march(const std::array<Corner, 4>& corners, bool positive, double iso, bool cut);

    /// Adds the line {U = iso} in a leaf triangle of a plane, where there is one: a "triangle"
    /// whose last two corners are equal. One mesh holds lines or triangles, not both.
    void march_line(const std::array<Corner, 3>& corners, double iso, bool cut);
    /// Adds a leaf triangle of the graph z = U over the xy plane, facing up.
    void add_graph(const std::array<Corner, 3>& corners, bool cut);

    [[nodiscard]] bool empty() const { return triangles_.empty() && elements_.empty(); }
    /// How many vertices are held; the owner bounds it by finishing the part.
    [[nodiscard]] std::size_t size() const { return elements_.size(); }
    /// Bytes of heap per vertex held, at most, finishing included.
    static constexpr std::size_t kBytesPerVertex = 460;

    /// Turns what was collected into a part and starts anew.
    MeshPart finish(const ClipBox& box);

  private:
    struct Element {
        VertexKey key;
        Double3 position;
        VertexAttributes attributes{};
        std::uint32_t parent = 0;  ///< union-find over names of the same vertex
        std::uint8_t uses = 0;     ///< tetrahedra that named it (fans and runs: two if complete)
    };
    struct Triangle {
        std::array<std::uint32_t, 3> v;
        bool cut;
    };

    std::uint32_t edge_vertex(const Corner& a, const Corner& b, double iso);
    std::uint32_t node_vertex(const Int3& node, const Double3& position);
    /// Names of the sheet at `node`, and of the middle of the edge ab that a sheet runs along.
    std::uint32_t fan_token(const Int3& node, const Int3& second);
    std::uint32_t run_token(const Corner& a, const Corner& b, const Corner& below);
    template <class MakeAttributes>
    std::uint32_t token(const VertexKey& key, const Double3& position,
                        const MakeAttributes& attributes);
    std::uint32_t fan(const Corner& node, const Corner& a0, const Corner& b0, const Corner& a1,
                      const Corner& b1);
    std::uint32_t root(std::uint32_t e);
    void unite(std::uint32_t a, std::uint32_t b);
    void add(std::uint32_t a, std::uint32_t b, std::uint32_t c, bool cut);
    void add_split(const std::array<std::uint32_t, 3>& v, const std::array<std::uint32_t, 3>& mid,
                   bool cut);
    std::uint32_t private_vertex(const Double3& position, const VertexAttributes& attributes);
    [[nodiscard]] VertexAttributes attributes_of(const Int3& a, const Int3& b, double t) {
        return attributes_ != nullptr ? attributes_->edge(a, b, t) : VertexAttributes{};
    }
    [[nodiscard]] VertexAttributes attributes_at(const Int3& node) {
        return attributes_ != nullptr ? attributes_->node(node) : VertexAttributes{};
    }
    void march_one_below(const Corner& q, const std::array<Corner, 3>& above, bool positive,
                         double iso, bool cut);
    void march_two_below(const Corner& a, const Corner& b, const Corner& q1, const Corner& q2,
                         bool positive, double iso, bool cut);

    AttributeSampler* attributes_ = nullptr;
    bool single_sheet_ = false;
    bool lines_ = false;
    tsl::robin_map<std::uint64_t, std::uint32_t, HalfLatticeHash> edges_;
    tsl::robin_map<VertexKey, std::uint32_t, VertexKeyHash> tokens_;
    std::vector<Element> elements_;
    std::vector<Triangle> triangles_;
};

}  // namespace isonest
