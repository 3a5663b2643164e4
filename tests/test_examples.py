"""Every example runs, at a reduced size, and gives the number that its docstring states."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from ilattice.lattice import Wall

FOLDER = Path(__file__).parents[1] / "examples"
NAMES = sorted(path.stem for path in FOLDER.glob("*.py"))


@pytest.fixture(autouse=True)
def meshes(monkeypatch):
    """The meshes that examples make; they are printable, all of them."""
    made, mesh = [], Wall.mesh

    def kept(self, *arguments, **options):
        made.append(mesh(self, *arguments, **options))
        return made[-1]

    monkeypatch.setattr(Wall, "mesh", kept)
    yield made
    for m in made:
        assert m.is_watertight
        assert m.is_oriented
        assert crossings(m) == 0
        assert np.percentile(m.quality, 1) >= 0.3


def crossings(mesh):
    """Pairs of triangles that intersect, found exactly by an independent library."""
    cgal = pytest.importorskip("igl.copyleft.cgal")
    x, faces = mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)
    return len(cgal.remesh_self_intersections(x, faces, detect_only=True)[2])


def run(name, call="main", **arguments):
    sys.path.insert(0, str(FOLDER))
    try:
        return getattr(importlib.import_module(name), call)(**arguments)
    finally:
        sys.path.remove(str(FOLDER))


def test_schwarz_p_torus_fills_two_fifths(meshes):
    numbers = run("schwarz_p_torus", h=0.12)
    assert numbers["filled"] == pytest.approx(0.41, abs=0.006)
    assert numbers["error"] < 1e-4
    assert len(meshes) == 1


def test_fig02_levels_are_not_thickness():
    spread = run("fig02_level_sets")
    low, high = spread["graded: level set"]
    assert low < 0.45
    assert high > 3.0
    low, high = spread["graded: parametric"]
    assert 0.8 < low < 0.9
    assert 1.1 < high < 1.3
    for name in ("primitive", "graded"):
        assert spread[f"{name}: euclidean"] == pytest.approx((1.0, 1.0), abs=1e-5)
    assert spread["lines"] == pytest.approx((1.0, 1.0), abs=0.01)
    assert spread["graded lines"] == pytest.approx((1.0, 1 / 3), abs=0.01)


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_design_loop_meets_its_target_without_new_distances():
    numbers = run("design_loop")
    assert 1 <= numbers["rounds"] <= 3
    assert numbers["compliance"] == pytest.approx(numbers["compliance asked for"], rel=0.01)
    assert numbers["new distances"] == 0
    assert 0 < numbers["material added"] < 0.2  # a wall as thick everywhere takes a quarter more


def test_changes_of_topology_lead_to_the_full_pipe():
    numbers = run("topology_sweep", tiles=1)
    assert numbers["Euler number of the thinnest wall"] == -4
    assert numbers["Euler number of the full pipe"] == 1
    assert 0.18 < numbers["first throat closes at"] < numbers["last throat closes at"] < 0.26


def test_fig01_arms_pass_through_opposite_faces_alike():
    numbers = run("fig01_tiles", n=32, tol=0.01)
    assert numbers["jump"] <= 1e-14
    assert numbers["open edges of a"] > 0
    assert numbers["open edges of b and c"] == 0
    assert numbers["volume of b"] == pytest.approx(0.215, rel=0.01)


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_fig03_boxes_of_the_domain_hold_tiles():
    numbers = run("fig03_tiles", h=0.05)
    assert numbers["difference"] <= 1e-14
    assert numbers["volume of the tile over that of the lines"] == pytest.approx(1.05, abs=0.02)
    assert numbers["uniform"] == pytest.approx(1.0, abs=1e-6)
    assert numbers["graded"] == pytest.approx(0.2 / 0.12, rel=0.03)  # to first order
    for method, error in (("uniform-sampling", 0.61), ("greville", 0.22), ("interpolate", 0.013)):
        assert numbers[method] == pytest.approx(error, rel=0.02)


def test_fig06_errors_of_parametric_offsets_are_of_second_order():
    numbers = run("fig06_variable_offsets", h=0.04)
    order = np.log2(numbers["schwarz_p: error at 1 d"] / numbers["schwarz_p: error at 0.5 d"])
    assert order == pytest.approx(2.0, abs=0.25)
    assert numbers["cross: error at 0.5 d"] < 0.4 * numbers["cross: error at 1 d"]
    assert numbers["cross: error at 1 d"] < 0.1 * 0.06


def test_fig07_walls_are_as_thick_as_asked_in_space_not_in_the_domain():
    numbers = run("fig07_lattice_space", h=0.05, cells=12)
    assert numbers["error in space"] < 1e-6
    assert numbers["thickness in the domain"] > 2.0
    assert numbers["inside"] < numbers["volume"] < numbers["inside or cut"]
    assert numbers["volume"] == pytest.approx(numbers["volume of the mesh"], rel=3e-3)


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_fig09_thicker_arms_fill_more():
    gained = run("fig09_colours", figures=("fig09",), coarser=1.5)
    assert gained["fig09"] == pytest.approx(1.71, abs=0.03)


def test_fig13_is_exact():
    numbers = run("fig13_tapered", h=0.1)
    assert numbers["error"] < 1e-6
    assert numbers["thickness at the sides"] == pytest.approx(0.3, abs=1e-6)


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_fig14_pores_close_where_the_wall_is_thick():
    genus = run("fig14_torus", h=0.12)
    for name, handles in (("gyroid", 481), ("diamond", 993)):
        assert genus[f"{name} constant"] == handles
        assert 0 < genus[f"{name} varying"] < handles
        assert genus[f"{name}: closed voids"] > 100
        assert 0 < genus[f"{name}: volume of the voids"] < 1.0
    assert 0.228 < genus["thickest pore"] < 0.2465  # from the throats to the last void


def test_fig14_says_at_which_thickness_the_topology_changes():
    found = run("fig14_torus", call="changes")
    first = {kind: min(p.value for p in found if p.kind == kind) for kind in ("bridge", "neck")}
    assert first["bridge"] == pytest.approx(0.125, abs=1e-4)
    assert first["neck"] == pytest.approx(0.228, abs=5e-4)
    assert max(p.value for p in found if p.kind == "neck") == pytest.approx(0.2342, abs=5e-4)
    assert found[-1].kind == "void"
    assert found[-1].value == pytest.approx(0.2436, abs=1e-4)  # the deepest place: by climbing


def test_fig15_thickness_is_right_everywhere():
    error = run("fig15_duck", d=0.04, h=0.045, repeat=(9, 3, 2), names=("gyroid",))
    assert 0 < error["gyroid"] < 1e-3


def test_fig16_struts_are_stiffer_than_a_wall_of_their_weight():
    numbers = run("fig16_bending", figures=("fig16c", "fig16d"), degree=2, coarser=2)
    assert 1.5 < numbers["wall to struts"] < 2.1
    assert numbers["fig16c: volume"] == pytest.approx(20.65, rel=2e-3)
    assert numbers["fig16d: volume"] == pytest.approx(21.68, rel=2e-3)
    assert numbers["fig16c: equilibrium"] < 1e-8
    assert numbers["fig16d: equilibrium"] < 1e-8


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_gismo_volume_is_filled_and_closed():
    numbers = run("gismo_iwp", d=0.05, h=0.06, repeat=(4, 1, 4))
    assert numbers["open edges"] == 0
    assert numbers["components"] == 1
    assert 0.05 < numbers["filled"] < 0.95


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_graded_bars_are_springs_in_series():
    numbers = run("graded_material", length=4)
    assert numbers["part to uniform"] == pytest.approx(np.log(7) / 1.5, rel=0.03)
    assert (
        1.0 < numbers["tile to uniform"] < 1.0 / np.sqrt(1.0 - 0.75**2)
    )  # all parallel, in series


def test_hierarchical_lattices_have_the_volume_of_their_points():
    numbers = run("hierarchical", h=0.125, steps=3)
    for step in numbers.values():
        assert step["watertight"]
        assert step["volume"] == pytest.approx(step["counted"], rel=0.02)


@pytest.mark.filterwarnings("ignore:the mesh with spacing")  # coarse
def test_solids_and_shells_of_nine_surfaces_have_their_volume():
    numbers = run("cesogen_showcase", names=("Gyroid", "P", "OCTO"), coarser=1.5)
    assert numbers["watertight"] == 1.0
    assert numbers["largest part by which volumes differ"] < 0.02


@pytest.mark.filterwarnings("ignore:the mesh with spacing")  # coarse
def test_meshes_of_meshes_are_farther_off_than_meshes_of_fields():
    numbers = run("cesogen_errors", h=8 / 50, ball=8 / 40, count=2)
    assert numbers["at once"] < 0.7 * numbers["one after the other"]
    trips = [numbers[f"after {k} roundtrips"] for k in range(3)]
    assert trips[0] < trips[1] < trips[2]


def test_triangles_of_a_gyroid_grow_with_the_square_of_the_grid():
    numbers = run("cesogen_times", points=(26, 101))
    assert numbers["exponent of the triangles"] == pytest.approx(2.0, abs=0.06)
    assert numbers["triangles for 101 points"] > 2e5


@pytest.mark.filterwarnings("ignore:the mesh")  # coarse
def test_every_tile_is_on_the_sheet():
    numbers = run("catalogue", names=("gyroid", "octet", "kagome", "square_honeycomb"), n=20)
    assert numbers["tiles"] == 4
    assert numbers["largest difference of filled parts"] < 0.02


def test_hybrid_tiles_have_the_asked_thickness_where_they_change():
    numbers = run("hybrid_tiles", h=0.06, cells=2)
    for name in ("hybrid", "random"):
        assert numbers[f"{name} closed"] == 1
        assert numbers[f"{name} parts"] == 1
        assert 0 <= numbers[f"{name} crumbs"] < 2e-3
        assert 0 < numbers[f"{name} error"] < 1e-3
    assert numbers["random crumbs"] > 1e-5


def test_mass_properties_by_quadrature_are_those_of_a_fine_mesh():
    numbers = run("mass_properties", h=0.06, repeat=(4, 1, 1))
    assert numbers["volume"] == pytest.approx(numbers["volume of the mesh"], rel=3e-3)
    assert numbers["volume"] == pytest.approx(numbers["volume by the divergence theorem"], rel=1e-4)
    assert numbers["area"] == pytest.approx(numbers["area of the mesh"], rel=1e-2)


def test_nested_lattices_fill_a_part_of_the_coarse_wall():
    numbers = run("nested_lattices", fine=0.02, finer=3)
    assert numbers["open edges"] == 0
    assert 0.0 <= numbers["crumbs"] < 0.01
    share = numbers["filled by the fine one"]
    assert numbers["of the coarse wall"] == pytest.approx(share, rel=0.05)


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_vibrations_are_below_rayleighs_estimate():
    numbers = run("vibrations", tiles=3, cells=5, count=3)
    assert 1.0 < numbers["Rayleigh's estimate to the lowest"] < 1.02
    assert numbers["bending to one side and the other"] == pytest.approx(1.0, abs=1e-4)
    assert numbers["torsion to bending"] > 2


def test_minimal_surfaces_have_the_areas_that_are_known():
    numbers = run("minimal_surfaces", n=24)
    genera = [numbers[f"genus of {name}"] for name in ("P", "I-WP", "Neovius", "F-RD")]
    assert genera == [3, 7, 9, 21]
    assert numbers["area of I-WP"] == pytest.approx(3.46416, abs=1e-4)


def test_effective_stiffnesses_are_within_bounds():
    numbers = run("effective_stiffness", cells=6)
    assert numbers["largest excess over the bound, in errors"] < 1.0
    for name in ("gyroid", "schwarz_p", "diamond", "iwp"):
        assert 0.5 < numbers[f"{name}: bulk modulus, part of its bound"] < 1.5
    stiffer = numbers["gyroid: E along a diagonal"] / numbers["gyroid: E along an axis"]
    assert 1.0 < stiffer < 1.5


def test_a_map_of_moduli_is_below_its_bounds():
    numbers = run("young_poisson_map", names=("gyroid", "primitive", "sc_plates"), cells=8)
    assert numbers["cells that bear in all directions"] == 3
    assert 0.8 < numbers["bulk modulus of the first, part of its bound"] < 1.0
    assert 0.05 < numbers["largest Young's modulus"] < 0.2


def test_infill_of_an_stl_part_has_walls_as_thick_as_asked():
    numbers = run("infill_stl", h=0.4)
    assert numbers["closed"] == 1.0
    assert 0.4 < numbers["volume with infill"] / numbers["volume of the part"] < 0.65
    assert numbers["99 % of the walls within"] < 0.03  # unpolished, at edges as long as the wall


def test_fluids_of_a_heat_exchanger_do_not_touch():
    numbers = run("heat_exchanger")
    assert numbers["closed"] == 1.0
    assert numbers["least gap between the fluids"] > 0.5  # of 0.8, less chords at coarse corners
    assert numbers["of the block"] == pytest.approx(1.0, abs=2e-3)
    hot, cold = (numbers[f"volume of {fluid}"] for fluid in ("hot", "cold"))
    assert hot == pytest.approx(cold, rel=0.1)


def test_a_trimmed_lattice_with_flanges_has_one_volume_by_mesh_and_by_rules():
    numbers = run("trimmed_flanges", h=0.45)
    assert numbers["closed"] == 1.0
    assert numbers["volume of the mesh"] == pytest.approx(numbers["volume"], rel=0.01)
    assert numbers["height of the middle of mass"] > 13.0


def test_balls_on_struts_stop_waves():
    numbers = run("bands", cells=6, steps=1)
    assert numbers["bands below the gap"] == 6
    assert numbers["gap to"] > 1.5 * numbers["gap from, in omega a / (2 pi c_T)"]
    # less what frequencies may be too high by, at the edges between balls and struts, too
    assert numbers["width of the gap"] == pytest.approx(0.32, abs=0.03)


def test_structures_in_the_duck_are_minimally_rigid():
    numbers = run("corner_sharing_duck")
    assert numbers["rank less three vertices and six"] == 0
    assert numbers["self-stresses"] == 0
    assert numbers["watertight"]


def test_forces_by_levels_are_those_of_the_whole():
    numbers = run("corner_sharing_stress", levels=1)
    assert numbers["difference of the levels"] < 1e-9
    assert numbers["edges"] == 4 * 306 + 72


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the cells are too coarse", "ignore:a gap of")
def test_solids_tend_to_frames_and_frames_to_trusses():
    numbers = run("corner_sharing_frames", solids=(0.1, 0.05), fineness=1.3)
    assert numbers["order of the frame"] == pytest.approx(2.0, abs=0.05)
    share = numbers["energy in bending of the thinnest, over what it lacks"]
    assert share == pytest.approx(1.0, abs=0.02)
    assert numbers["frame over truss, r = 0.0015625 L"] > 0.99
    thick, thin = (
        [numbers[f"{what} over truss, r = {r:g} L"] for what in ("frame", "solid")]
        for r in (0.1, 0.05)
    )
    assert thick[1] < thick[0] < thin[0] < 1.0
    assert thick[1] < thin[1] < thin[0]
    assert 0.5 < numbers["order of the solid"] < 1.5


def test_structures_with_defects_break_sooner():
    numbers = run("corner_sharing_fracture")
    assert numbers["collapsed"]
    assert numbers["stiffness in the end, over that at first"] < 0.02
    assert numbers["largest load"] < numbers["largest load without defects"]
    assert numbers["edges that break"] > 5


def test_motions_keep_lengths_and_exchanges_rigidity():
    numbers = run("corner_sharing_motions", frames=4)
    assert numbers["largest change of a length"] < 1e-9
    assert numbers["largest displacement"] > 0.1
    assert numbers["self-stresses after the exchange"] == 0
    assert numbers["motions after the exchange"] == 0
    assert numbers["deficit by R1"] == 3 * 7 - 3
    assert abs(numbers["resistances less vertices but one"]) < 1e-8


def test_flips_make_a_hole_that_is_nearly_round():
    numbers = run("corner_sharing_flips")
    assert numbers["largest radius over the least"] == pytest.approx(1.02, abs=0.03)
    assert numbers["corners of the hole"] == 12
    assert numbers["overlaps"] == 0


def test_mapped_kagome_structures_make_a_ball():
    numbers = run("corner_sharing_sphere", resolution=4)
    assert numbers["farthest from the sphere"] < 0.001
    assert numbers["vertices"] == 8 * 68 - 12 * 7  # faces of neighbours share 7
    assert numbers["overlaps"] == 0
    coarse = run("corner_sharing_sphere", resolution=4, degree=2)
    assert coarse["farthest from the sphere"] > 0.05


def test_flips_in_all_layers_make_a_cylindrical_hole():
    numbers = run("corner_sharing_holes", resolution=7, layers=4)
    assert numbers["largest radius over the least"] == pytest.approx(1.0, abs=0.05)
    assert numbers["corners of the hole"] == 12
    assert numbers["overlaps"] == 0
    assert numbers["contours of the slice in a layer"] == 1


def test_refinement_halves_the_volume_and_keeps_the_deficit():
    numbers = run("corner_sharing_refined")
    assert numbers["volume per level, over that before"] == pytest.approx(0.5, rel=1e-12)
    assert numbers["deficit at first"] == 6 * 3 * 1
    for name in ("deficit at the end", "deficit where only one side is refined"):
        assert numbers[name] == numbers["deficit at first"]
    assert numbers["spread of lengths"] < 1e-12


def test_flips_of_triangulations_are_flips_of_structures():
    numbers = run("corner_sharing_bijection")
    assert numbers["vertices that differ"] == 0
    assert numbers["flips"] > 20
    assert numbers["spread of areas"] < 1e-12
    assert numbers["spread of lengths"] > 0.2


def test_slices_make_few_blocks_of_a_structure():
    numbers = run("corner_sharing_slices", resolution=16)
    assert numbers["part of the blocks"] < 0.7
    assert numbers["polygons"] > 10


def test_smooth_solids_of_structures_are_closed():
    numbers = run("corner_sharing_smooth", resolution=3, h=0.03)
    # vertices and what is between them are alike, turned inside out
    assert numbers["solid part of space"] == pytest.approx(0.5, abs=1e-5)
    assert numbers["watertight"]
    assert numbers["crossing triangles"] == 0


@pytest.mark.filterwarnings("ignore:the spline that stands for d")
def test_walls_are_as_thick_as_data_say():
    numbers = run("thickness_from_data")
    assert numbers["largest part by which walls differ from the table"] < 1e-3
    assert numbers["volume by table"] == pytest.approx(numbers["volume by image"], rel=0.02)


@pytest.mark.filterwarnings("ignore:the spline that quadrature")
def test_struts_of_a_graph_have_the_radii_of_their_nodes():
    numbers = run("strut_graph")
    assert numbers["watertight"]
    assert numbers["pieces"] == 1
    assert numbers["largest part by which radii are off"] < 2e-3
    assert numbers["handles"] == 52 - 20 + 1


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_a_core_between_two_faces_has_walls_of_one_thickness():
    numbers = run("conformal_layer", h=0.9)
    assert numbers["watertight"]
    assert numbers["99th percentile of errors of the thickness"] < 1e-3
    assert numbers["least height"] >= 0.0


def test_boundaries_of_shells_are_twenty():
    numbers = run("shells_boundaries")
    assert numbers == {"classes": 20, "closed choices": 256, "that repeat by shifts": 3}


def test_shells_meet_their_mirrors_at_right_angles():
    numbers = run("shells_variations", n=16)
    slopes = [numbers[name] for name in numbers if "slope" in name]
    assert len(slopes) == 4
    assert max(slopes) < 0.04
    assert numbers["P-like, symmetric: area"] == pytest.approx(2.345, rel=0.01)


def test_shells_have_the_topology_of_what_they_are_like():
    numbers = run("shells_gallery", n=16)
    euler = {name.split(", ")[1].split(":")[0]: number for name, number in numbers.items()}
    assert euler["topo_1_ttt"] == euler["topo_1_rrr"] == -16
    assert euler["topo_8_rrr"] == -40
    assert euler["topo_18_rrr"] == -12
    assert euler["topo_19_rrr"] == -4


def test_graded_shells_fit_each_other():
    numbers = run("shells_graded", cells=2, n=20, h=0.025)
    assert numbers["jump of normals between cells"] < 1e-6
    assert numbers["open edges"] == 0


def test_mean_curvatures_of_shells_are_small():
    numbers = run("shells_curvature", n=24)
    for name in ("P-like", "IWP-like", "N-like"):
        assert numbers[f"{name}: median of |H|"] < 0.05
    assert numbers["P-like: area"] == pytest.approx(2.345, rel=0.01)


def test_a_shell_like_schwarz_p_is_isotropic():
    numbers = run("shells_isotropic", n=20, cells=6)
    assert numbers["Zener's ratio"] == pytest.approx(1.0, abs=0.02)
    assert numbers["Zener's ratio of Schwarz P"] > 1.5
    assert 1.5 < numbers["derivative"] < 3.0


def test_shells_reach_more_stiffnesses_than_level_sets():
    numbers = run("shells_moduli", count=4, levels=3, cells=4)
    assert numbers["P-like: shells"] >= 3
    assert numbers["N-like: shells"] >= 3
    for kind in "PN":
        assert (
            numbers[f"{kind}-like: area of the hull"] > numbers[f"{kind}: area of the hull"] > 0.0
        )


@pytest.mark.filterwarnings("ignore:the mesh with spacing")  # coarse
def test_specimens_of_an_isotropic_shell_are_solids_in_all_directions():
    numbers = run("shells_directions", tiles=2, cells=6, h=0.12)
    for name in ("[100]", "[110]", "[111]"):
        assert numbers[f"{name}: closed"]
        assert numbers[f"{name}: density"] == pytest.approx(0.3, abs=0.07)  # a cell or two
    assert numbers["largest over least modulus"] < 1.1
    assert numbers["that of Schwarz P"] > 1.4


def test_shells_vary_more_than_level_sets():
    numbers = run("shells_shapes", n=12, h=0.05)
    spread = [number - 1.0 for number in numbers.values()]
    assert spread[1] > 1.5 * spread[0] > 0.0


def test_shells_have_more_surface_than_sheets_of_formulas():
    numbers = run("shells_surface", kinds=("P",), n=12, h=0.1)
    assert numbers["P-like"] > 1.01 * numbers["P"]
    assert numbers["P"] == pytest.approx(2 * 2.345 / 0.3, rel=0.05)  # of thin walls


def test_a_cantilever_of_shells_that_vary_is_stiffer_than_one_of_equal_ones():
    numbers = run("shells_cantilever", repeat=(3, 3, 1), rounds=3, cells=4, per_tile=3, n=14)
    assert numbers["compliance over that of equal cells"] < 0.9
    assert numbers["relative density"] == pytest.approx(0.3, abs=0.03)
    assert numbers["closed"]


def test_homogeneous_arches_come_near_to_those_of_tiles():
    one, two = (abs(e) for e in run("homogenized_beam", most=2, per_tile=4).values())
    assert two < 0.7 * one
    assert two < 0.2


@pytest.mark.parametrize("name", NAMES)
def test_every_example_is_tested_and_can_be_run_alone(name):
    source = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    assert f'run("{name}"' in Path(__file__).read_text(encoding="utf-8")
    assert 'if __name__ == "__main__":' in source
    assert f"python examples/{name}.py" in source


def test_a_graph_of_three_vertices_is_the_octet_of_the_catalogue():
    numbers = run("graph_structures", points=2000)
    assert numbers["largest difference of the octets"] < 1e-12
    assert numbers["nodes of octet"] == 12


def test_the_more_a_boundary_may_slide_the_smaller_is_the_surface():
    areas = run("graph_surfaces", edges=8)
    assert areas["area of the direct surface"] == pytest.approx(np.sqrt(27) / 2, rel=1e-9)
    assert areas["area of the conjugate surface"] == pytest.approx(2.34511, abs=2e-4)


def test_lengths_of_the_dual_polygon_of_iwp_are_roots():
    numbers = run("graph_conjugate_steps", edges=12)
    assert numbers["side 2 over side 1"] == pytest.approx(np.sqrt(2.0), rel=1e-3)
    assert numbers["side 3 over side 1"] == pytest.approx(2.0, rel=1e-3)
    assert numbers["area"] == pytest.approx(3.46410, rel=2e-3)


def test_blocks_for_a_printer_hold_27_cells():
    numbers = run("graph_printed", seeds=2, cells=12, wall=4.0, h=1.4, kinds=("truss",))
    cell = numbers["density of the truss cell"]
    assert numbers["density of the truss block"] == pytest.approx(cell, rel=0.03)


def test_random_graphs_stay_below_the_bound():
    parts = run("graph_exploration", seeds=(0, 2), cells=12)
    assert 0.0 < max(parts.values()) < 1.0


def test_heavy_balls_on_rods_leave_a_gap():
    numbers = run("graph_bandgap", cells=4, steps=1, path="GX")
    assert numbers["relative width of the gap"] > 0.5


def test_decks_have_the_volume_of_the_wall_and_the_force(tmp_path):
    numbers = run("calculix_export", h=0.8, cells=20, out=str(tmp_path / "bar"))
    for name in ("hexahedra", "tetrahedra")[: len(numbers) // 2]:
        assert numbers[f"volume of {name} over that of the wall"] == pytest.approx(1.0, abs=0.04)
        assert numbers[f"resultant of {name}, off by"] < 1e-11
        assert (tmp_path / f"bar_{name}.inp").stat().st_size > 1e5


@pytest.mark.filterwarnings("ignore:the cells are too coarse")  # which bars show
def test_thicker_walls_are_stiffer_and_heavier(tmp_path):
    out = str(tmp_path / "sweep")
    numbers = run("thickness_sweep", thickness=(0.04, 0.08), cells=7, out=out)
    for name, most in (("gyroid", 1.6), ("primitive", 1.6)):
        assert numbers[f"{name}: density over 2 d area"] == pytest.approx(1.0, abs=0.02)
        assert 1.0 < numbers[f"{name}: exponent of E"] < most
    assert 0.3 < numbers["largest part of the upper bound"] < 1.0
    assert Path(f"{out}.png").stat().st_size > 1e4
