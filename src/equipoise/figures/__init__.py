"""What is seen of a robot and of a result, before anything draws it: shapes, and the plan view."""
