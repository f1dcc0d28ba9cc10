"""The picture of the manual: a surface within two distances, in ParaView.   Usage: pvpython figure.py STORE PICTURE.png"""
import pathlib
import sys

from paraview.simple import GetActiveViewOrCreate, LoadPlugin, Render, ResetCamera, SaveScreenshot, Show

store, picture = sys.argv[1:3]
LoadPlugin(str(pathlib.Path(__file__).with_name("isonest_paraview.py")), remote=False, ns=globals())
view = GetActiveViewOrCreate("RenderView")
view.ViewSize = [900, 450]
view.UseColorPaletteForBackground = 0
view.Background = [1, 1, 1]
view.OrientationAxesVisibility = 0
for number, voxels in enumerate((0, 0.5)):
    surface = IsonestSurface(FileName=store, Isovalues=[0.5], Within="distance, in voxels", Tolerance=voxels)
    shown = Show(surface, view)
    shown.Representation = "Surface With Edges" if voxels else "Surface"
    shown.ColorArrayName = [None, ""]
    shown.DiffuseColor = shown.AmbientColor = [0.78, 0.62, 0.42]
    shown.EdgeColor = [0.2, 0.2, 0.2]
    surface.UpdatePipeline()
    low, high = surface.GetDataInformation().GetBounds()[:2]
    shown.Position = [number * 1.05 * (high - low), 0, 0]
ResetCamera(view)
view.CameraParallelProjection = 1
view.CameraParallelScale *= 0.52
Render(view)
SaveScreenshot(picture, view, ImageResolution=[900, 450])
