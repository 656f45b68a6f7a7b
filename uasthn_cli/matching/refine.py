"""Refine corners: warp the map by the current homography, correlate locally, fit four corners.

As in IHN a small network reads a local correlation volume and updates four corners, again and
again. Unlike IHN, it does not regress the update: it proposes where each cell of the thermal image
should move and how much to trust that, and a weighted least-squares fit turns the field into
corners. The fit carries the geometry, so the network stays tiny and learns in minutes.
"""

import torch
import torch.nn.functional as F  # noqa: N812 (the name everyone knows)
from torch import Tensor, nn

from uasthn_cli.geometry.corners import DegenerateHomographyError
from uasthn_cli.matching.correlate import normalise_template

RADIUS_CELLS = 4
ITERATIONS = 1
"""Iterations of an estimate: on rendered flights further ones made corners worse."""

TRAINING_ITERATIONS = 4
PATCH_CELLS = 11
_ENERGY_EPSILON = 1e-12
_HIDDEN = 32
_MIN_WEIGHT = 1e-4


class Refiner(nn.Module):
    """Corners in, better corners out; all coordinates in feature cells."""

    def __init__(self) -> None:
        """Build an untrained refiner: a plain local soft-argmax, as its last layer starts at 0."""
        super().__init__()
        shifts = (2 * RADIUS_CELLS + 1) ** 2
        last = nn.Conv2d(_HIDDEN, shifts + 1, 1)
        self.body = nn.Sequential(
            nn.Conv2d(shifts + 1, _HIDDEN, 1),
            nn.ReLU(inplace=True),
            nn.Conv2d(_HIDDEN, _HIDDEN, 3, padding=1),
            nn.ReLU(inplace=True),
            nn.Conv2d(_HIDDEN, _HIDDEN, 3, padding=2, dilation=2),
            nn.ReLU(inplace=True),
            last,
        )
        for parameter in last.parameters():
            nn.init.zeros_(parameter)
        self.log_sharpness = nn.Parameter(torch.tensor(2.7))
        self.log_stiffness = nn.Parameter(torch.tensor(-3.0))

    def forward(
        self, window: Tensor, template: Tensor, mask: Tensor, corners: Tensor, iterations: int
    ) -> list[Tensor]:
        """Return the corners after each iteration.

        ``window`` ``(B, C, H, W)`` map features, ``template`` ``(B, C, h, w)`` thermal features,
        ``mask`` ``(B, 1, h, w)``, ``corners`` ``(B, 4, 2)``: where the centres of the template's
        corner cells lie in the window, in window cells. Gradients do not flow between iterations.
        """
        template = normalise_template(template, mask)
        points = template_points(template.shape[-2:], corners)
        basis = _bilinear_basis(template.shape[-2:], corners)
        results = []
        for _ in range(iterations):
            corners = corners.detach()
            H = homography(_template_corners(template.shape[-2:], corners), corners)
            shift, weight = self._match(window, template, mask, H)
            moved = apply_homography(H, points + shift) - apply_homography(H, points)
            corners = corners + self._fit(basis, moved, weight)
            results.append(corners)
        return results

    def _match(
        self, window: Tensor, template: Tensor, mask: Tensor, H: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the shift ``(B, h * w, 2)`` each template cell asks for, and its weight."""
        volume, energy = correlation_volume(window, template, H)
        output = self.body(torch.cat([volume, mask], dim=1))
        logits = output[:, :-1] + volume * self.log_sharpness.exp()
        probability = torch.softmax(logits, dim=1).flatten(2)
        shift = torch.einsum("bsn,sd->bnd", probability, _shifts(window))
        weight = torch.sigmoid(output[:, -1:]) * energy * mask
        return shift, weight.flatten(1)

    def _fit(self, basis: Tensor, moved: Tensor, weight: Tensor) -> Tensor:
        """Return the corner update ``(B, 4, 2)`` whose bilinear field best explains ``moved``.

        A stiffness holds the corners' updates together where little is seen.
        """
        weight = weight / weight.sum(dim=1, keepdim=True).clamp_min(_MIN_WEIGHT)
        weighted = basis * weight[:, :, None]
        gram = weighted.transpose(1, 2) @ basis
        identity = torch.eye(4, device=basis.device, dtype=basis.dtype)
        apart = identity - 0.25
        gram = gram + self.log_stiffness.exp() * apart + 1e-5 * identity
        update: Tensor = torch.linalg.solve(gram, weighted.transpose(1, 2) @ moved)
        return update


def correlation_volume(window: Tensor, template: Tensor, H: Tensor) -> tuple[Tensor, Tensor]:
    """Return how well a patch around each template cell fits the map at each shift.

    The volume ``(B, (2r + 1)², h, w)`` is the normalised correlation of patches of ``PATCH_CELLS``
    (a single cell's features are too ambiguous), its second part ``(B, 1, h, w)`` the energy of the
    template's patches. ``H`` ``(B, 3, 3)`` takes template cells to window cells.
    """
    height, width = template.shape[-2:]
    r = RADIUS_CELLS
    ys = torch.arange(-r, height + r, device=window.device, dtype=window.dtype)
    xs = torch.arange(-r, width + r, device=window.device, dtype=window.dtype)
    grid = torch.stack(torch.meshgrid(xs, ys, indexing="xy"), dim=-1).reshape(1, -1, 2)
    places = apply_homography(H, grid.expand(len(H), -1, -1))
    size = torch.tensor(window.shape[-2:][::-1], device=window.device, dtype=window.dtype)
    scaled = (2 * places + 1) / size - 1  # align_corners=False: cell centres on whole numbers
    scaled = scaled.view(len(H), height + 2 * r, width + 2 * r, 2)
    warped = F.grid_sample(window, scaled, align_corners=False)
    shifts = [(dy, dx) for dy in range(2 * r + 1) for dx in range(2 * r + 1)]

    def shifted(image: Tensor) -> list[Tensor]:
        return [image[:, :, dy : dy + height, dx : dx + width] for dy, dx in shifts]

    products = torch.stack([(template * piece).sum(dim=1) for piece in shifted(warped)], dim=1)
    map_energy = _patch_mean((warped**2).sum(dim=1, keepdim=True))
    energy = _patch_mean((template**2).sum(dim=1, keepdim=True))
    norm = torch.cat(shifted(map_energy), dim=1) * energy
    return _patch_mean(products) / torch.sqrt(norm + _ENERGY_EPSILON), energy


def _patch_mean(x: Tensor) -> Tensor:
    """Return the mean over square patches of ``PATCH_CELLS``, rows first and then columns."""
    rows = F.avg_pool2d(x, (1, PATCH_CELLS), 1, (0, PATCH_CELLS // 2))
    return F.avg_pool2d(rows, (PATCH_CELLS, 1), 1, (PATCH_CELLS // 2, 0))


def homography(source: Tensor, target: Tensor) -> Tensor:
    """Return ``H`` ``(B, 3, 3)`` from corners ``(B, 4, 2)`` to corners by the DLT.

    Raises:
        DegenerateHomographyError: the corners do not define a homography.
    """
    x, y = source[..., 0], source[..., 1]
    u, v = target[..., 0], target[..., 1]
    one, zero = torch.ones_like(x), torch.zeros_like(x)
    rows_u = torch.stack([x, y, one, zero, zero, zero, -x * u, -y * u], dim=-1)
    rows_v = torch.stack([zero, zero, zero, x, y, one, -x * v, -y * v], dim=-1)
    A, b = torch.cat([rows_u, rows_v], dim=1), torch.cat([u, v], dim=1)
    solution, failed = torch.linalg.solve_ex(A.double(), b.double()[..., None])
    if bool(failed.any()):
        raise DegenerateHomographyError("three refined corners lie on one line")
    h: Tensor = solution[..., 0]
    H = torch.cat([h, torch.ones_like(h[:, :1])], dim=1).view(-1, 3, 3)
    return H.to(source.dtype)


def apply_homography(H: Tensor, points: Tensor) -> Tensor:
    """Map points ``(B, n, 2)`` by ``H`` ``(B, 3, 3)``."""
    mapped = points @ H[:, :, :2].transpose(1, 2) + H[:, None, :, 2]
    return mapped[..., :2] / mapped[..., 2:]


def template_points(size: torch.Size, like: Tensor) -> Tensor:
    """Return the template's cells ``(1, h * w, 2)`` as ``(x, y)``."""
    ys = torch.arange(size[0], device=like.device, dtype=like.dtype)
    xs = torch.arange(size[1], device=like.device, dtype=like.dtype)
    return torch.stack(torch.meshgrid(xs, ys, indexing="xy"), dim=-1).reshape(1, -1, 2)


def _template_corners(size: torch.Size, like: Tensor) -> Tensor:
    right, bottom = size[1] - 1.0, size[0] - 1.0
    corners = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]]
    return torch.tensor(corners, device=like.device, dtype=like.dtype).expand(len(like), -1, -1)


def _bilinear_basis(size: torch.Size, like: Tensor) -> Tensor:
    """Return how much each corner counts at each cell ``(1, h * w, 4)``."""
    points = template_points(size, like)
    x, y = points[..., 0] / (size[1] - 1), points[..., 1] / (size[0] - 1)
    return torch.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], dim=-1)


def _shifts(like: Tensor) -> Tensor:
    """Return the shifts ``((2r + 1)², 2)`` of the volume's planes as ``(x, y)``."""
    steps = torch.arange(-RADIUS_CELLS, RADIUS_CELLS + 1, device=like.device, dtype=like.dtype)
    return torch.stack(torch.meshgrid(steps, steps, indexing="xy"), dim=-1).reshape(-1, 2)
