"""`shade` for plain surfaces under one rectangle of light, LANES paths side by side.

Shading a path is one chain of instructions that wait for each other; those of other paths can be done meanwhile. What
is written has the same bytes as by `shade`, which has the last word on what shading is, and takes all other paths.
"""

from typing import Any

import taichi as ti

from tiscene.render import warp
from tiscene.render.bsdfs.inputs import LEAST_COSINE
from tiscene.render.integrators.path_kernels import FIRST_STEP_SET, Floats2, Ints1, Ints2, path_number
from tiscene.render.integrators.path_shading import (
    DIRECTION_SET,
    LARGEST_SURVIVAL,
    LIGHT_SET,
    LOBE_SET,
    RUSSIAN_ROULETTE_DEPTH,
    SCATTERED_SPREAD,
    SETS,
    write3,
)
from tiscene.render.integrators.path_state import (
    ALBEDO,
    DEPTH_MASK,
    DIRECT,
    LIVE,
    NORMAL,
    RADIANCE,
    RELATIVE_IOR2,
    SAMPLED,
    SEEN,
    SHADED,
    SPREAD,
    THROUGHPUT,
    States,
    get3,
    write_state,
)
from tiscene.render.intersect.wide import larger, smaller
from tiscene.render.lanes import (
    LANES,
    Bundle,
    Floats,
    Triple,
    Words,
    along_axes,
    choose,
    combined,
    cosine_hemisphere,
    cross,
    dot,
    largest,
    length,
    magnitudes,
    of_lane,
    put,
    triple_of,
    unit_or,
    where,
    zeros,
)
from tiscene.render.lights import rect_lanes
from tiscene.render.lights.light_sample import color
from tiscene.render.lights.met import LIGHT_FRONT, power_heuristic, response
from tiscene.render.ray_arrays import HitIds, Hits, Pixels, Rays, ray_direction, ray_origin, write_ray
from tiscene.render.sampler import draw_words, reverse_bits, set_keys, unit
from tiscene.render.surface import (
    FLOATS_3D,
    HAS_NORMALS,
    INFO_FLAGS,
    OFFSET,
    Geometry,
    moved_by,
    row3,
)
from tiscene.scene.light_table import KIND, RECT, SHADOWLESS, SHAPED, TEXTURE
from tiscene.scene.material_table import DIFFUSE, EMITS, FLAGS, PLAIN
from tiscene.scene.placement import CURRENT

vec3 = ti.math.vec3

PANEL = 0  # the only row of the lights


def lone_panel(light_values: Any) -> bool:
    """Whether the lights are one rectangle as `shade_plain` wants it."""
    if light_values.shape[0] != 1:
        return False
    light = light_values.to_numpy()[PANEL]
    return bool(light[KIND] == RECT and light[TEXTURE] < 0 and light[SHAPED] == 0 and light[SHADOWLESS] == 0)


@ti.func
def room_for_paths():
    """What is read of every path: a Bundle."""
    return Bundle(
        plain=Floats(0.0),  # 1 where the path is one for this kernel
        number=Words(0),
        depth=Floats(0.0),  # of surfaces met, with this one
        origin=zeros(), direction=zeros(), throughput=zeros(), radiance=zeros(), ior2=Floats(0.0), spread=Floats(0.0),
        distance=Floats(0.0), b1=Floats(0.0), b2=Floats(0.0),
        color=zeros(), v0=zeros(), v1=zeros(), v2=zeros(),
        curved=Floats(0.0), n0=zeros(), n1=zeros(), n2=zeros(),
        world_x=zeros(), world_y=zeros(), world_z=zeros(), place=zeros(),  # rows of world_from_instance
        inverse_x=zeros(), inverse_y=zeros(), inverse_z=zeros(),  # columns of instance_from_world
    )  # fmt: skip


@ti.func
def put_matrix_row(row: ti.template(), lane: ti.i32, matrices: ti.template(), instance: ti.i32, first, step):
    """Three numbers of a matrix at CURRENT, so many apart."""
    x, y = matrices[CURRENT, instance, first], matrices[CURRENT, instance, first + step]
    put(row, lane, vec3(x, y, matrices[CURRENT, instance, first + 2 * step]))


@ti.func
def read_surface(met: ti.template(), lane: ti.i32, geometry: ti.template(), instance: ti.i32, triangle: ti.i32):
    """What of the scene's arrays is at a triangle of an instance."""
    moved = moved_by(geometry.instance_info, instance, CURRENT)
    flags = geometry.instance_info[instance, INFO_FLAGS]
    for k, position, normal in ti.static(((0, met.v0, met.n0), (1, met.v1, met.n1), (2, met.v2, met.n2))):
        vertex = geometry.triangle_vertices[triangle, k] + moved
        put(position, lane, row3(geometry.vertex_position, vertex))
        if flags & HAS_NORMALS:
            met.curved[lane] = 1.0
            put(normal, lane, row3(geometry.vertex_normal, vertex))
    for k, row, column in ti.static(
        ((0, met.world_x, met.inverse_x), (1, met.world_y, met.inverse_y), (2, met.world_z, met.inverse_z))
    ):
        put_matrix_row(row, lane, geometry.world_from_instance, instance, 4 * k, 1)
        put_matrix_row(column, lane, geometry.instance_from_world, instance, k, 4)
    put_matrix_row(met.place, lane, geometry.world_from_instance, instance, 3, 4)


@ti.func
def numbers(keys: ti.template(), index: ti.template()):
    """`draw` for every path."""
    a, b = draw_words(keys, index)
    u, v = Floats(0.0), Floats(0.0)
    for lane in range(LANES):
        u[lane] = unit(a[lane])
        v[lane] = unit(b[lane])
    return u, v


@ti.func
def surfaces(met: ti.template()):
    """What `surface_at` and `shading_normal` say of the points that were met: a Bundle."""
    b0 = 1.0 - met.b1 - met.b2
    e1, e2 = met.v1 - met.v0, met.v2 - met.v0
    point = met.v0 + e1 * met.b1 + e2 * met.b2
    wo = met.direction * -1.0
    outward = unit_or(along_axes(met.inverse_x, met.inverse_y, met.inverse_z, cross(e1, e2)), wo)
    mean = combined(met.n0, met.n1, met.n2, Triple(b0, met.b1, met.b2))
    smooth = unit_or(along_axes(met.inverse_x, met.inverse_y, met.inverse_z, mean), outward)
    along = ti.select(dot(smooth, outward) < 0.0, Floats(-1.0), Floats(1.0))
    side = ti.select(dot(outward, met.direction) > 0.0, Floats(-1.0), Floats(1.0))
    normal = choose(met.curved > 0.0, smooth * along, outward) * side
    position = along_axes(met.world_x, met.world_y, met.world_z, point) + met.place
    side1 = along_axes(met.world_x, met.world_y, met.world_z, e1)
    side2 = along_axes(met.world_x, met.world_y, met.world_z, e2)
    sides = larger(largest(magnitudes(side1)), largest(magnitudes(side2)))
    cosine = dot(normal, wo)
    bent = normal + wo * (LEAST_COSINE - cosine)
    return Bundle(
        position=position,
        geometric_normal=outward * side,
        normal=choose(cosine < LEAST_COSINE, bent * (1.0 / length(bent)), normal),
        offset=OFFSET * larger(larger(largest(magnitudes(position)), sides), Floats(0.1)),
    )


@ti.func
def offset_origins(surface: ti.template(), direction: ti.template()):
    """`offset_origin` of every path."""
    side = ti.select(dot(surface.geometric_normal, direction) < 0.0, Floats(-1.0), Floats(1.0))
    return surface.position + surface.geometric_normal * (side * surface.offset)


@ti.func
def seen_from(surface: ti.template(), direction: ti.template()):
    """Whether a direction is on one side of the surface and of its shading normal: 1 or 0."""
    return where(dot(surface.geometric_normal, direction) * dot(surface.normal, direction) > 0.0)


@ti.func
def lit(met: ti.template(), surface: ti.template(), values: ti.template(), u, v, mis: ti.i32):
    """What the light adds to the paths, where a ray reaches it: a Bundle of sampled, direct, direction, reach."""
    light = rect_lanes.sample(values, PANEL, surface.position, u, v)
    density = larger(dot(surface.normal, light.direction), Floats(0.0)) * warp.INV_PI
    unweighted = met.throughput * (met.color * density) * triple_of(color(values, PANEL))
    first, later = response(values, PANEL, 1.0, 1), response(values, PANEL, 1.0, 2)
    reflected = ti.select(met.depth > 1.0, later * Floats(1.0), first * Floats(1.0))
    weight = Floats(1.0)
    if mis != 0:
        weight = power_heuristic(light.pdf, density)
    direct = unweighted * (reflected / light.pdf) * weight
    sampled = where(light.pdf > 0.0) * seen_from(surface, light.direction) * where(largest(direct) > 0.0)
    return Bundle(sampled=sampled, direct=direct, direction=light.direction, reach=light.distance * (1.0 - LIGHT_FRONT))


@ti.func
def onward(met: ti.template(), surface: ti.template(), u, v, survival_number):
    """Where the paths go on, if they do: a Bundle of goes_on, direction, pdf, throughput, spread."""
    direction, height = cosine_hemisphere(surface.normal, u, v)
    pdf = larger(height, Floats(0.0)) * warp.INV_PI
    throughput = met.throughput * (met.color * pdf) * (1.0 / pdf)
    brightest, one = largest(throughput), Floats(1.0)
    roulette = smaller(ti.sqrt(brightest * met.ior2), LARGEST_SURVIVAL * one)
    survival = ti.select(met.depth >= RUSSIAN_ROULETTE_DEPTH, roulette, one)
    return Bundle(
        goes_on=where(pdf > 0.0)
        * seen_from(surface, direction)
        * where(survival_number < survival)
        * where(brightest > 0.0),
        direction=direction,
        pdf=pdf,
        throughput=throughput * (1.0 / survival),
        spread=larger(met.spread, SCATTERED_SPREAD / ti.sqrt(pdf)),
    )


@ti.kernel
def shade_plain(
    vertex_position: Floats2,
    vertex_normal: Floats2,
    vertex_uv: Floats2,
    triangle_vertices: Ints2,
    triangle_material: Ints1,
    instance_info: Ints2,
    world_from_instance: FLOATS_3D,
    instance_from_world: FLOATS_3D,
    material_values: Floats2,
    material_info: Ints2,
    light_values: Floats2,
    pixels: Pixels,
    first: ti.i32,
    spp: ti.i32,
    bits: ti.i32,
    frame_key: ti.i32,
    step: ti.i32,
    max_depth: ti.i32,
    mis: ti.i32,
    queue: Ints1,
    count: ti.i32,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    shadow_rays: Rays,
    occluded: Ints1,
    state: States,
    features: Floats2,
    status: Ints1,
    first_sample: ti.i32,
    light_ends: ti.i32,
):
    """Advance those paths in the queue that met a PLAIN surface, not the last, by one vertex; they are SHADED then.

    There is one light: a rectangle without an image or shaping, which casts shadows. light_ends: 1 where a last edge
    counts by that alone and is as long as the others, so that one that misses it need not be. Else as `shade`.
    """
    geometry = ti.static(
        Geometry(
            vertex_position,
            vertex_normal,
            vertex_uv,
            triangle_vertices,
            triangle_material,
            instance_info,
            world_from_instance,
            instance_from_world,
        )
    )
    ti.loop_config(block_dim=128)
    for begin in range(count):
        if begin % LANES == 0:  # a block; by blocks, Taichi would give a thread 512 of them at least
            end = ti.min(begin + LANES, count)
            met = room_for_paths()
            for k in range(begin, end):
                i, lane = queue[k], k - begin
                instance, triangle = hit_ids[i][0], hit_ids[i][1]
                depth = (status[i] & DEPTH_MASK) + 1
                if instance >= 0 and depth < max_depth:
                    material = triangle_material[triangle]
                    if material_info[material, FLAGS] & (PLAIN | EMITS) == PLAIN:
                        met.plain[lane] = 1.0
                        met.number[lane] = path_number(pixels, first + i, spp, bits, first_sample)
                        met.depth[lane] = ti.cast(depth, ti.f32)
                        put(met.origin, lane, ray_origin(rays, i))
                        put(met.direction, lane, ray_direction(rays, i))
                        put(met.throughput, lane, get3(state, i, THROUGHPUT))
                        radiance = get3(state, i, RADIANCE)
                        if (status[i] & SAMPLED) != 0 and occluded[i] == 0:
                            radiance += get3(state, i, DIRECT)
                        put(met.radiance, lane, radiance)
                        met.ior2[lane], met.spread[lane] = state[i][RELATIVE_IOR2], state[i][SPREAD]
                        met.distance[lane], met.b1[lane], met.b2[lane] = hits[i][0], hits[i][1], hits[i][2]
                        for c, channel in ti.static(enumerate((met.color.x, met.color.y, met.color.z))):
                            channel[lane] = ti.math.clamp(material_values[material, DIFFUSE + c], 0.0, 1.0)
                        read_surface(met, lane, geometry, instance, triangle)

            # Here, since vectors made before the loop are kept where they are not aligned.
            sets = FIRST_STEP_SET + SETS * step
            index = reverse_bits(met.number)
            light_u, light_v = numbers(set_keys(frame_key, sets + LIGHT_SET), index)
            onward_u, onward_v = numbers(set_keys(frame_key, sets + DIRECTION_SET), index)
            survival_number = Floats(0.0)
            if step + 1 >= RUSSIAN_ROULETTE_DEPTH:
                _, survival_number = numbers(set_keys(frame_key, sets + LOBE_SET), index)
            panel_distance = rect_lanes.intersect(light_values, PANEL, met.origin, met.direction)
            plain = met.plain * where(panel_distance >= met.distance * (1.0 + LIGHT_FRONT))
            surface = surfaces(met)
            light = lit(met, surface, light_values, light_u, light_v, mis)
            shadow_origin = offset_origins(surface, light.direction)
            way = onward(met, surface, onward_u, onward_v, survival_number)
            way_origin = offset_origins(surface, way.direction)
            if light_ends != 0 and step + 2 == max_depth:  # then nothing but the light counts
                way.goes_on *= where(rect_lanes.intersect(light_values, PANEL, way_origin, way.direction) < ti.math.inf)
            after = met.depth + SAMPLED * light.sampled + LIVE * way.goes_on  # a status, small enough for a float

            for k in range(begin, end):
                i, lane = queue[k], k - begin
                if plain[lane] > 0.0:  # all is written, needed or not: branches would cost more
                    if (status[i] & SEEN) == 0:
                        write3(features, i, ALBEDO, of_lane(met.color, lane))
                        write3(features, i, NORMAL, of_lane(surface.normal, lane))
                    write_state(
                        state, i, of_lane(way.throughput, lane), of_lane(met.radiance, lane), way.pdf[lane],
                        met.ior2[lane], of_lane(light.direct, lane), of_lane(surface.position, lane), way.spread[lane],
                        1.0,
                    )  # fmt: skip
                    reach = light.reach[lane]
                    write_ray(shadow_rays, i, of_lane(shadow_origin, lane), of_lane(light.direction, lane), reach)
                    write_ray(rays, i, of_lane(way_origin, lane), of_lane(way.direction, lane), ti.math.inf)
                    status[i] = ti.cast(after[lane], ti.i32) | SEEN | SHADED
