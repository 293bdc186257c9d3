from dartpy.common import Uri
from dartpy.dynamics import Skeleton

class DartResourceRetriever:
    def __init__(self) -> None: ...

class DartLoader:
    def __init__(self) -> None: ...
    def parseSkeletonString(
        self, urdfString: str, baseUri: Uri, resourceRetriever: DartResourceRetriever
    ) -> Skeleton | None: ...
