"""Links and inertia: fixed joints merged, mass properties and limits looked over."""
