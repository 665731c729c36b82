"""One kernel that fills the arrays of instances: four separate uploads would cost more than the tree over them."""

import taichi as ti

INFO_COLUMNS = 17

Table = ti.types.ndarray(ti.f32, 2)
Tables = ti.types.ndarray(ti.f32, 3)
Ids = ti.types.ndarray(ti.i32, 2)


@ti.kernel
def fill(
    given_info: Ids,
    given_world: Tables,
    given_inverse: Tables,
    given_box: Table,
    info: Ids,
    world: Tables,
    inverse: Tables,
    box: Table,
):
    """Copy host arrays to device arrays of the same shapes: [n, 17], [3, n, 12] twice, [n, 12]."""
    for i in range(given_info.shape[0]):
        for c in ti.static(range(INFO_COLUMNS)):
            info[i, c] = given_info[i, c]
        for c in range(12):
            box[i, c] = given_box[i, c]
            for time in range(3):
                world[time, i, c] = given_world[time, i, c]
                inverse[time, i, c] = given_inverse[time, i, c]
