from assetbuild.api import Bundle as Bundle
from assetbuild.api import Facts as Facts
from assetbuild.api import build as build
from assetbuild.api import load_bundle as load_bundle

__version__: str
