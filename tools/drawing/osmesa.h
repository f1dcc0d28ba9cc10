// Mesa's off-screen renderer, loaded when first used: it brings a compiler along (LLVM), whose
// loading takes longer than many an extraction.
#pragma once

#include <GL/gl.h>
#include <GL/osmesa.h>

namespace isonest::detail {

// The functions that tools/drawing/picture.cpp calls.
#define ISONEST_OSMESA_FUNCTIONS(F) \
    F(OSMesaCreateContextAttribs)   \
    F(OSMesaDestroyContext)         \
    F(OSMesaMakeCurrent)            \
    F(OSMesaPixelStore)             \
    F(glClear)                      \
    F(glClearColor)                 \
    F(glColorMaterial)              \
    F(glColorPointer)               \
    F(glColor3fv)                   \
    F(glDepthFunc)                  \
    F(glDisable)                    \
    F(glDisableClientState)         \
    F(glDrawArrays)                 \
    F(glEnable)                     \
    F(glEnableClientState)          \
    F(glFinish)                     \
    F(glLightModelfv)               \
    F(glLightModeli)                \
    F(glLightfv)                    \
    F(glLineWidth)                  \
    F(glLoadIdentity)               \
    F(glMaterialfv)                 \
    F(glMatrixMode)                 \
    F(glNormalPointer)              \
    F(glOrtho)                      \
    F(glPolygonMode)                \
    F(glPolygonOffset)              \
    F(glReadPixels)                 \
    F(glVertexPointer)              \
    F(glViewport)

struct OsMesa {
// NOLINTNEXTLINE(bugprone-macro-parentheses): a name to declare
#define ISONEST_OSMESA_MEMBER(name) decltype(&::name) name = nullptr;
    ISONEST_OSMESA_FUNCTIONS(ISONEST_OSMESA_MEMBER)
#undef ISONEST_OSMESA_MEMBER
};

/// Throws Error{unsupported} if the library cannot be loaded. Thread-safe.
const OsMesa& osmesa();

}  // namespace isonest::detail
